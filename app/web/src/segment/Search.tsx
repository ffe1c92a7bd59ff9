/** Finds places on the map. */
export function Search() {
  return null;
}

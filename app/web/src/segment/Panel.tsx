/** What a click on the map opens. */
export function Panel() {
  return null;
}

/** A time that runs, as stop watches show it. */
export function clock(ms: number): string {
  const seconds = Math.max(Math.floor(ms / 1000), 0);
  const parts = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60, seconds % 60];
  return parts.map((part, k) => (k === 0 ? String(part) : String(part).padStart(2, "0"))).join(":");
}

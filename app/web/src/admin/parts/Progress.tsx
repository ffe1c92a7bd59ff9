/** How far something is, as a bar and in figures. */
import { number } from "../../shared/format";

export function Progress({ share, label }: { share: number; label: string }) {
  return (
    <span class="progress">
      <progress value={share} max={1} aria-label={label} />
      <span>{number(100 * share)} %</span>
    </span>
  );
}

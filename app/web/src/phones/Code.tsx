/** A text as a QR code that a phone's camera reads: dark on light in either theme. */
import { encode } from "uqr";

export function Code({ text, label }: { text: string; label: string }) {
  const { size, data } = encode(text, { ecc: "L", border: 4 });
  const dark = data.flatMap((row, y) => row.flatMap((is, x) => (is ? [`M${x} ${y}h1v1h-1z`] : [])));
  return (
    <svg class="code" viewBox={`0 0 ${size} ${size}`} role="img" aria-label={label}>
      <rect width={size} height={size} class="light" />
      <path d={dark.join("")} class="dark" />
    </svg>
  );
}

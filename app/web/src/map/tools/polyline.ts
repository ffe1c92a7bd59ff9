/** Lines as short texts: Google's polyline of five decimals, each place as the step from the one before. */
import type { Position } from "../state";

const SCALE = 1e5;
/** Longer ones are not kept in the address: not every browser and server takes it then. */
export const MOST_CHARACTERS = 1500;

function number(value: number): string {
  let left = value < 0 ? ~(value << 1) : value << 1;
  let text = "";
  for (; left >= 0x20; left >>>= 5) text += String.fromCharCode((0x20 | (left & 0x1f)) + 63);
  return text + String.fromCharCode(left + 63);
}

export function encoded(line: readonly Position[]): string {
  let [x, y] = [0, 0];
  return line
    .map(([lon, lat]) => {
      const [column, row] = [Math.round(lon * SCALE), Math.round(lat * SCALE)];
      const step = number(row - y) + number(column - x);
      [x, y] = [column, row];
      return step;
    })
    .join("");
}

/** The places of a text; none where it is no line on Earth. */
export function decoded(text: string): Position[] {
  const numbers: number[] = [];
  let [value, shift] = [0, 0];
  for (const character of text) {
    const bits = character.charCodeAt(0) - 63;
    if (bits < 0 || bits > 0x3f || shift > 30) return [];
    value |= (bits & 0x1f) << shift;
    shift += 5;
    if (bits & 0x20) continue;
    numbers.push(value & 1 ? ~(value >>> 1) : value >>> 1);
    [value, shift] = [0, 0];
  }
  if (shift > 0 || numbers.length % 2 || numbers.length < 4) return [];
  const line: Position[] = [];
  let [x, y] = [0, 0];
  for (let k = 0; k < numbers.length; k += 2) {
    y += numbers[k] as number;
    x += numbers[k + 1] as number;
    line.push([x / SCALE, y / SCALE]);
  }
  return line.every(([lon, lat]) => Math.abs(lon) <= 180 && Math.abs(lat) <= 90) ? line : [];
}

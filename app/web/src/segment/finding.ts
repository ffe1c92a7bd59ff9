/** What a text in the search field may mean. Asks nobody. */

export type Meaning =
  | { kind: "place"; lon: number; lat: number; zoom?: number }
  | { kind: "segment"; id: number }
  | { kind: "way"; id: number }
  | { kind: "number"; id: number }
  | { kind: "name"; name: string }
  | { kind: "wrong"; why: "place" | "number" | "node" | "short" };

const SHORTEST_NAME = 3;

function numbered(kind: "segment" | "way" | "number", digits: string): Meaning {
  const id = Number(digits);
  return Number.isSafeInteger(id) && id > 0 ? { kind, id } : { kind: "wrong", why: "number" };
}

function place(lat: number, lon: number, zoom?: number): Meaning {
  if (!(Math.abs(lat) <= 90 && Math.abs(lon) <= 180)) return { kind: "wrong", why: "place" };
  return { kind: "place", lon, lat, ...(zoom === undefined ? {} : { zoom }) };
}

function ofLink(text: string): Meaning | null {
  if (!/openstreetmap\.org|osm\.org|^geo:/i.test(text)) return null;
  const way = /\/way\/(\d+)/.exec(text);
  if (way) return numbered("way", way[1] as string);
  const marked = /[?&]mlat=(-?[\d.]+)&mlon=(-?[\d.]+)/.exec(text);
  if (marked) return place(Number(marked[1]), Number(marked[2]));
  const map = /map=(\d+(?:\.\d+)?)\/(-?[\d.]+)\/(-?[\d.]+)/.exec(text);
  if (map) return place(Number(map[2]), Number(map[3]), Number(map[1]));
  const geo = /^geo:(-?[\d.]+),(-?[\d.]+)/i.exec(text);
  if (geo) return place(Number(geo[1]), Number(geo[2]));
  return { kind: "wrong", why: "node" };
}

const SIZE = String.raw`([+-]?\d+(?:\.\d+)?)\s*°?\s*(?:(\d+(?:\.\d+)?)\s*['′’]\s*)?(?:(\d+(?:\.\d+)?)\s*["″”]\s*)?`;
const LETTER = "([NSEWO])?";
/** Letters stand before all angles, or behind them. */
const BEFORE = new RegExp(`${LETTER}\\s*${SIZE}()`, "gi");
const BEHIND = new RegExp(`()${SIZE}${LETTER}`, "gi");

/** Degrees of one angle, and by its letter whether it is a latitude. */
function angle(match: RegExpMatchArray): { degrees: number; axis: "lat" | "lon" | null } | null {
  const [, before, degrees = "", minutes = "0", seconds = "0", after] = match;
  const letter = (before || after || "").toUpperCase();
  if (Number(minutes) >= 60 || Number(seconds) >= 60) return null;
  const size = Math.abs(Number(degrees)) + Number(minutes) / 60 + Number(seconds) / 3600;
  const negative = degrees.startsWith("-") !== ("SW".includes(letter) && letter !== "");
  return {
    degrees: negative ? -size : size,
    axis: letter === "" ? null : "NS".includes(letter) ? "lat" : "lon",
  };
}

/** Two angles as people write them: 49.41, 8.69 or 49° 24.6' N 8° 41.4' E; latitude first unless letters say else. */
function ofPlace(text: string): Meaning | null {
  if (!/\d/.test(text) || !/^[\d\s.,;°'′’"″”+\-NSEWO/]+$/i.test(text)) return null;
  // Commas are points in 49,41 8,69 and part the two in 49.41,8.69.
  const points = text.includes(".") || !/\d,\d+\s*[;\s/°'′’NSEWO]/i.test(text);
  const clean = points
    ? text.replace(/[,;/]/g, " ")
    : text.replace(/(\d),(\d)/g, "$1.$2").replace(/[,;/]/g, " ");
  const form = /^\s*[NSEWO]/i.test(clean) ? BEFORE : BEHIND;
  const matches = [...clean.matchAll(form)];
  const rest = clean.replace(form, "").trim();
  const angles = matches.map(angle);
  const [first, second] = angles;
  if (angles.length !== 2 || rest !== "" || !first || !second) return null;
  if (first.axis !== null && first.axis === second.axis) return { kind: "wrong", why: "place" };
  const swapped =
    first.axis === "lon" || second.axis === "lat" || (first.axis === null && Math.abs(first.degrees) > 90);
  return swapped ? place(second.degrees, first.degrees) : place(first.degrees, second.degrees);
}

/** What somebody who wrote this looks for; null: nothing was written. */
export function meaning(written: string): Meaning | null {
  const text = written.trim().replace(/\s+/g, " ");
  if (text === "") return null;
  const link = ofLink(text);
  if (link) return link;
  const named = /^(segment|abschnitt|way|weg)\s*[#:/]?\s*(\d+)$/i.exec(text);
  if (named) return numbered(/^(segment|abschnitt)/i.test(text) ? "segment" : "way", named[2] as string);
  if (/^#?\d+$/.test(text)) return numbered("number", text.replace("#", ""));
  const here = ofPlace(text);
  if (here) return here;
  if (/^[\d\s.,°'"+-]+$/.test(text)) return { kind: "wrong", why: "place" };
  return text.length < SHORTEST_NAME ? { kind: "wrong", why: "short" } : { kind: "name", name: text };
}

const quoted = (text: string) => `'${text.replaceAll("'", "''")}'`;
const capital = (text: string) => text.charAt(0).toLocaleUpperCase() + text.slice(1);

/** Roads of just this name, also with a capital where none was written; the index on names answers it. */
export function exactly(name: string): string {
  const ways = [...new Set([name, capital(name)])];
  return `name IN (${ways.map(quoted).join(", ")})`;
}

/** From the first name on that begins so, or from behind one: in their order the index on names answers it at once. */
export function fromName(name: string, after: string | null): string {
  return after === null ? `name >= ${quoted(capital(name))}` : `name > ${quoted(after)}`;
}

/** Whether a name begins with what was written. */
export const begins = (name: string, written: string) => name.startsWith(capital(written));

/** Metres between two places, near enough to say which of two is nearer. */
export function apart(a: { lon: number; lat: number }, b: { lon: number; lat: number }): number {
  const radians = Math.PI / 180;
  const x = (b.lon - a.lon) * radians * Math.cos(((a.lat + b.lat) / 2) * radians);
  return 6_371_000 * Math.hypot(x, (b.lat - a.lat) * radians);
}

/** The guides in the order in which somebody needs them. One that stands on no shelf is on the last. */
import { type Guide, guides } from "virtual:guides";

const SHELVES = {
  use: ["pages", "recording", "exports", "handover", "clients", "items", "changes"],
  run: ["operation", "threats"],
  inside: ["architecture", "methods", "network", "positioning", "particle", "cheap_filter", "experiments"],
} as const;
export type Shelf = keyof typeof SHELVES;

/** Each shelf with its guides. */
export function shelves(): [Shelf, Guide[]][] {
  const known = new Map(guides.map((one) => [one.name, one]));
  const placed = (Object.entries(SHELVES) as [Shelf, readonly string[]][]).map(
    ([shelf, names]): [Shelf, Guide[]] => [
      shelf,
      names.flatMap((name) => {
        const guide = known.get(name);
        known.delete(name);
        return guide ? [guide] : [];
      }),
    ],
  );
  placed.at(-1)?.[1].push(...known.values());
  return placed;
}

/** The guide of that name. */
export function guideNamed(name: string): Guide | undefined {
  return guides.find((one) => one.name === name);
}

/** Those guides in whose title, summary or headings every word is found. */
export function guidesWith(words: string[]): Guide[] {
  return guides.filter((one) => {
    const text = [one.title, one.summary, ...one.headings.map((each) => each.text)].join(" ").toLowerCase();
    return words.every((word) => text.includes(word));
  });
}

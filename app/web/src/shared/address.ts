/**
 * The address of a page says what it shows: a reload, a link to somebody else, Back and Forward show it again.
 *
 * The rule of all pages. What a person chooses is an entry of the history, and so is taking a choice back: a road, a place,
 * a region, colours, a filter, an order, a page of a list, what is compared, a number of days, a section, an operation.
 * What goes on bit by bit replaces its entry: panning and zooming, letters after the first, and what a page writes by
 * itself. Back and Forward write nothing: the page shows what the address says.
 */
import { computed, signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";

/** What is asked for: the address's query with its question mark, or nothing. */
export const search = signal(location.search);
const fragment = signal(location.hash);

function read(): void {
  search.value = location.search;
  fragment.value = location.hash;
}
// A link within the page changes the fragment; not every browser tells that by both.
addEventListener("popstate", read);
addEventListener("hashchange", read);

/** Write an address. Writing what is there already is no step. */
export function goTo(address: string, inPlace = false): void {
  const to = new URL(address, location.href);
  if (to.href === location.href) return;
  if (inPlace) history.replaceState(null, "", to);
  else history.pushState(null, "", to);
  read();
}

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text; // what somebody else wrote may be no code at all
  }
}

/** The parts of the page that the address's fragment names, separated by commas; the last is the one to look at. */
export const named = computed(() => fragment.value.slice(1).split(",").map(decoded).filter(Boolean));

/** The part to look at. */
export const lookedAt = computed(() => named.value.at(-1) ?? "");

/** Whether a part that folds is open, and what opens or folds it: one that was not open at first is in the address. */
export function useFold(id: string, openAtFirst = false): [boolean, (open: boolean) => void] {
  const isNamed = named.value.includes(id);
  const [open, set] = useState(openAtFirst || isNamed);
  useEffect(() => {
    if (isNamed || !openAtFirst) set(isNamed);
  }, [isNamed, openAtFirst]);
  const fold = (wanted: boolean) => {
    set(wanted);
    const others = named.peek().filter((one) => one !== id);
    const names = wanted && !openAtFirst ? [...others, id] : others;
    goTo(location.pathname + location.search + (names.length > 0 ? `#${names.join(",")}` : ""));
  };
  return [open, fold];
}

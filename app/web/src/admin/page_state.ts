/** What the whole page shares: the reader, how many days are looked at, what this service offers, what is open. */
import { computed, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { getJson } from "../shared/api";
import { Reader, type Reading } from "./reading";
import type { Answer, QueryList } from "./types";

export const DAYS = [1, 7, 30, 365] as const;

export const reader = new Reader((address) => getJson(address));

function daysOfAddress(): number {
  const asked = Number(new URLSearchParams(location.search).get("days"));
  return DAYS.find((one) => one === asked) ?? 30;
}

/** How many days back, for figures by day. */
export const days = signal<number>(daysOfAddress());

export function chooseDays(chosen: number): void {
  days.value = chosen;
  const here = new URL(location.href);
  here.searchParams.set("days", String(chosen));
  history.replaceState(null, "", here);
}

const LIST = "/v1/admin";
const list = reader.watch(LIST, 600) as Reading<QueryList>;
const offered = computed(() => new Set(list.data.value?.queries.map((one) => one.name)));

/** Whether it is known what there is to be read. */
export const ready = computed(() => list.data.value !== null);
export const listProblem = list.problem;

/** Whether the service has a query of that name. */
export function offers(query: string | undefined): boolean {
  return query === undefined || offered.value.has(query);
}

/** What is at an address, read again every so many seconds while the component is shown. */
export function useReading<T>(address: string, everyS: number): Reading<T> {
  useEffect(() => {
    reader.watch(address, everyS);
    return () => reader.unwatch(address);
  }, [address, everyS]);
  return reader.at(address) as Reading<T>;
}

/** The rows of a named query. */
export function useQuery<Row>(
  name: string,
  everyS: number,
  ofDays: number | null = null,
): Reading<Answer<Row>> {
  return useReading(`/v1/admin/${name}${ofDays === null ? "" : `?days=${ofDays}`}`, everyS);
}

/** The section that the address asks for; another object each time somebody asks. */
export const wantedSection = signal({ id: location.hash.slice(1) });
const want = () => {
  wantedSection.value = { id: location.hash.slice(1) };
};
addEventListener("hashchange", want);
// A link to where the address is already changes nothing of it, but what it leads to may be folded.
addEventListener("click", (event) => {
  const link = event.target instanceof Element ? event.target.closest("a") : null;
  if (link?.getAttribute("href") === location.hash && location.hash) want();
});

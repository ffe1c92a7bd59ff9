/** What the whole page shares: the reader, how many days are looked at, what this service offers, what is open. */
import { computed } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { goTo, search } from "../shared/address";
import { getJson } from "../shared/api";
import { Reader, type Reading } from "./reading";
import type { Answer, QueryList } from "./types";

export const DAYS = [1, 7, 30, 365] as const;

export const reader = new Reader((address) => getJson(address));

/** How many days back, for figures by day. */
export const days = computed<number>(() => {
  const asked = Number(new URLSearchParams(search.value).get("days"));
  return DAYS.find((one) => one === asked) ?? 30;
});

export function chooseDays(chosen: number): void {
  const here = new URL(location.href);
  here.searchParams.set("days", String(chosen));
  goTo(here.href);
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

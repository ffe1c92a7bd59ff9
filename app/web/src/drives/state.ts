/** The list as the address says it: the page's query is the one that the service is asked with, so a reload changes nothing. */
import { computed, effect, signal } from "@preact/signals";
import type { components } from "../api/schema";
import { goTo, search } from "../shared/address";
import { getJson } from "../shared/api";
import type { Drive } from "../shared/drives";
import { Follower } from "../shared/following";
import { whenTold } from "../shared/tabs";
import { waitsForRoads } from "../shared/Waits";

type Listed = Omit<components["schemas"]["DriveList"], "drives"> & { drives: Drive[] };

export const SORTS = ["created_at", "drive_time", "distance_m", "filename", "status"] as const;
export type Sort = (typeof SORTS)[number];
export const STATUSES = ["queued", "running", "done", "failed", "cancelled"] as const;
export const FILTERS = [
  "q",
  "status",
  "failure",
  "waits_for",
  "created_after",
  "created_before",
  "batch",
] as const;
type Parameter = (typeof FILTERS)[number] | "sort" | "order" | "after" | "before";
const KNOWN: readonly string[] = [...FILTERS, "sort", "order", "after", "before"];
const PER_PAGE = "50";

export const query = computed(() => read(search.value));
export const drives = signal<Drive[] | null>(null);
export const links = signal<Listed["links"]>([]);
export const problem = signal<unknown>(null);
export const loading = signal(false);
export const selected = signal<ReadonlySet<string>>(new Set());

function read(asked: string): URLSearchParams {
  const given = new URLSearchParams(asked);
  for (const [name, value] of [...given]) if (!KNOWN.includes(name) || value === "") given.delete(name);
  return given;
}

/** What a sort begins with where nobody chose. */
export function usualOrder(sort: Sort): "asc" | "desc" {
  return sort === "filename" || sort === "status" ? "asc" : "desc";
}

export const sort = computed<Sort>(
  () => SORTS.find((one) => one === query.value.get("sort")) ?? "created_at",
);
export const order = computed<"asc" | "desc">(() => {
  const named = query.value.get("order");
  return named === "asc" || named === "desc" ? named : usualOrder(sort.value);
});
export const filtered = computed(() => FILTERS.some((name) => query.value.has(name)));

/** The address of the list with these parameters changed; null takes one away. Another list begins at its beginning. */
export function addressWith(changes: Partial<Record<Parameter, string | null>>): string {
  const next = new URLSearchParams(query.value);
  next.delete("after");
  next.delete("before");
  for (const [name, value] of Object.entries(changes)) {
    if (value === null || value === "") next.delete(name);
    else next.set(name, value);
  }
  return next.size > 0 ? `/drives?${next}` : "/drives";
}

/** Show another part of the list. */
export const go = goTo;

/** The address of the next or previous page; null: there is none. */
export function pageTo(rel: "next" | "prev"): string | null {
  const href = links.value.find((link) => link.rel === rel)?.href;
  if (href === undefined) return null;
  const name = rel === "next" ? "after" : "before";
  return addressWith({ [name]: new URL(href).searchParams.get(name) });
}

let current: AbortController | null = null;

/** Ask for what the address says. */
export async function load(): Promise<void> {
  current?.abort();
  const mine = new AbortController();
  current = mine;
  loading.value = true;
  const asked = new URLSearchParams(query.value);
  asked.set("limit", PER_PAGE);
  try {
    const listed = await getJson<Listed>(`/v1/drives?${asked}`, mine.signal);
    drives.value = listed.drives;
    links.value = listed.links;
    problem.value = null;
    const shown = new Set(listed.drives.map((drive) => drive.id));
    selected.value = new Set([...selected.value].filter((id) => shown.has(id)));
    follower.arrange();
  } catch (error) {
    if (mine.signal.aborted) return;
    problem.value = error;
  }
  loading.value = false;
}

function change(id: string, drive: Drive | null): void {
  drives.value = (drives.value ?? []).flatMap((one) => (one.id !== id ? [one] : drive ? [drive] : []));
}

const follower = new Follower<string>({
  driveOf: (id) => id,
  unfinished: () =>
    (drives.value ?? [])
      .filter((one) => ["queued", "running"].includes(one.status) || waitsForRoads(one))
      .map((one) => one.id)
      .reverse(),
  onDrive: (id, drive) => change(id, drive),
  gone: (id) => change(id, null),
  rests: (id) => (drives.value ?? []).some((one) => one.id === id && waitsForRoads(one)),
});

/** Begin: once, by the page. */
export function begin(): void {
  effect(() => {
    query.value; // whatever changes it
    void load();
  });
  whenTold(() => void load());
}

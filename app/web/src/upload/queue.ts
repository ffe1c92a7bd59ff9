/** What is uploaded from this page: each item with what became of it, so many transfers at once. */
import { computed, type Signal, signal } from "@preact/signals";
import { ApiProblem, api, got } from "../shared/api";
import { type Drive, getDrive } from "../shared/drives";
import { Follower } from "../shared/following";
import { tellError } from "../shared/Messages";
import { isNoLog } from "../shared/remarks";
import { inWords } from "../shared/said";
import { tellTabs } from "../shared/tabs";
import { t } from "../shared/texts";
import { waitsForRoads } from "../shared/Waits";
import { Refusal } from "./request";
import { type Accepted, type LeftOut, send, type Transfer, type Unclear, type Uploaded } from "./transfers";
import { opened, type Sendable } from "./zip";

export type Phase =
  | "waiting"
  | "sending"
  | "refused"
  | "queued"
  | "running"
  | "done"
  | "failed"
  /** No roads are where it was driven; it is computed by itself when there are. */
  | "roads"
  | "cancelled";

/** What a reload of the page leaves of an upload that has become a drive. */
export interface Kept {
  name: string;
  size: number;
  driveId: string;
  known: boolean;
  leftOut: LeftOut[];
}

/** Statuses of what is no log, or none that is wanted. */
const UNUSED = [0, 415, 422];
const AT_ONCE = 2;
const TRIES = 4;
let last = 0;

/** One drive to be, of one file or of several; or a zip, of which nobody knows yet how many drives it holds. */
export class Item {
  readonly id: number;
  readonly name: string;
  readonly size: number;
  readonly phase: Signal<Phase> = signal("waiting");
  readonly sent = signal(0);
  /** It waits for the connection to come back. */
  readonly lost = signal(false);
  readonly problem: Signal<ApiProblem | null> = signal(null);
  readonly drive: Signal<Drive | null> = signal(null);
  /** Of the drive that it became; empty before. */
  driveId = "";
  readonly known = signal(false);
  /** Names of columns: Versant's -> the file's. */
  columns: Record<string, string> = {};
  tries = 0;
  notBefore = 0;
  transfer: Transfer | null = null;
  /** Files of it that were not used. */
  readonly leftOut: Signal<LeftOut[]> = signal([]);
  /** Files of it that could be several drives. */
  readonly unclear: Signal<Unclear[]> = signal([]);
  /** The drive that this upload is to make several of. */
  instead: Item | null = null;

  /**
   * `part`: what is called by that name among the files, which are sent no more; `kept`: of before a reload;
   * `archive`: the zip of many rides that they are a few of, and `list` what it says of their sports.
   */
  constructor(
    readonly files: Sendable[],
    readonly query: URLSearchParams,
    readonly part = "",
    kept?: Kept,
    readonly archive = "",
    readonly list: File | null = null,
  ) {
    last += 1;
    this.id = last;
    this.name = kept?.name ?? (part || this.run);
    this.size = kept?.size ?? (part ? 0 : files.reduce((sum, file) => sum + file.size, 0));
    if (kept === undefined) return;
    this.driveId = kept.driveId;
    this.sent.value = kept.size;
    this.known.value = kept.known;
    this.leftOut.value = kept.leftOut;
    this.phase.value = "queued";
  }

  /** What was sent. */
  get origin(): string {
    return this.archive || this.files.map((file) => file.name).join(", ");
  }

  /** What its files are called together; of an archive in short. */
  private get run(): string {
    const [first] = this.files;
    if (!this.archive || !first) return this.origin;
    const n = this.files.length - 1;
    return n === 0 ? first.name : t("upload.run", { n, first: first.name });
  }

  /** Tells the same files from others. */
  get key(): string {
    const names = this.files.map((file) => `${file.name}/${file.size}/${file.lastModified}`);
    return [this.archive, ...names].join("|");
  }
}

export const items = signal<Item[]>([]);
const OVER: Phase[] = ["refused", "done", "failed", "roads", "cancelled"];
/** A file in a zip that came to nothing: no drive to be. */
export const isLeftOut = (item: Item) =>
  item.phase.value === "refused" &&
  (item.part !== "" || (item.archive !== "" && UNUSED.includes(item.problem.value?.status ?? 0)));
const isOver = (item: Item) => OVER.includes(item.phase.value);

export interface Overall {
  count: number;
  over: number;
  done: number;
  bad: number;
  /** Of these, how many may be tried again. */
  again: number;
  roads: number;
  bytes: number;
  sent: number;
  transferring: boolean;
}

/** How far all of it is. */
export const overall = computed<Overall>(() => {
  const all = items.value.filter((item) => !isLeftOut(item));
  const of = (...phases: Phase[]) => all.filter((item) => phases.includes(item.phase.value)).length;
  return {
    count: all.length,
    over: all.filter(isOver).length,
    done: of("done"),
    bad: of("refused", "failed"),
    again: all.filter(mayRetry).length,
    roads: of("roads"),
    bytes: all.reduce((sum, item) => sum + item.size, 0),
    sent: all.reduce((sum, item) => sum + Math.min(item.sent.value, item.size), 0),
    transferring: of("waiting", "sending") > 0,
  };
});

const follower = new Follower<Item>({
  driveOf: (item) => item.driveId,
  unfinished: () => items.value.filter((item) => ["queued", "running", "roads"].includes(item.phase.value)),
  rests: (item) => item.phase.value === "roads",
  onDrive: (item, drive) => tell(item, drive),
  gone: (item) => {
    item.phase.value = "cancelled";
  },
});

function tell(item: Item, drive: Drive): void {
  item.drive.value = drive;
  item.phase.value = waitsForRoads(drive) ? "roads" : drive.status;
}

/** Look what has become of all drives. */
export async function look(): Promise<void> {
  for (const item of items.value.filter((one) => one.driveId !== "")) {
    try {
      tell(item, await getDrive(item.driveId));
    } catch (error) {
      if (!(error instanceof ApiProblem && error.status === 404)) continue;
      // Of before a reload: whoever logged in since is told nothing of somebody else's files.
      if (item.files.length === 0) remove(item);
      else item.phase.value = "cancelled";
    }
  }
  follower.arrange();
}

/** Put drives into the queue; those that are in it already are left out. Returns how many there are now more. */
export function add(drives: File[][], query: URLSearchParams): number {
  return put(drives.map((files) => new Item(files, query)));
}

/** The same of a zip of many rides, in runs, with files of it that are not sent; `list` by run what it says of them. */
export function addArchive(
  name: string,
  runs: Sendable[][],
  others: Sendable[],
  query: URLSearchParams,
  list: (run: Sendable[]) => File | null,
): number {
  const unused = others.map((file) => {
    const one = new Item([file], query, file.name, undefined, name);
    one.problem.value = new ApiProblem(0, "", t("upload.picture"));
    one.phase.value = "refused";
    return one;
  });
  return put([...runs.map((files) => new Item(files, query, "", undefined, name, list(files))), ...unused]);
}

function put(all: Item[]): number {
  const there = new Set(items.value.filter((item) => item.phase.value !== "refused").map((item) => item.key));
  const fresh = all.filter((item) => !there.has(item.key));
  items.value = [...items.value, ...fresh];
  pump();
  return fresh.length;
}

/** Begin transfers while there are some to begin. */
function pump(): void {
  const all = items.value;
  let free = AT_ONCE - all.filter((item) => item.phase.value === "sending").length;
  const now = Date.now();
  for (const item of all) {
    if (free <= 0) return;
    if (item.phase.value !== "waiting" || item.notBefore > now) continue;
    free -= 1;
    void transfer(item);
  }
}

async function transfer(item: Item): Promise<void> {
  item.phase.value = "sending";
  item.problem.value = null;
  item.sent.value = 0;
  item.tries += 1;
  const query = new URLSearchParams(item.query);
  for (const [ours, theirs] of Object.entries(item.columns)) query.append("columns", `${ours}=${theirs}`);
  try {
    const files = await opened(item.files);
    if (!items.value.includes(item)) return;
    item.transfer = send(item.list ? [...files, item.list] : files, query, {
      sent: (bytes) => {
        item.sent.value = bytes;
      },
      lost: (is) => {
        item.lost.value = is;
      },
    });
    await settle(item, await item.transfer.done);
    tellTabs();
    follower.arrange();
  } catch (error) {
    if (items.value.includes(item)) fail(item, error);
  } finally {
    item.transfer = null;
    item.lost.value = false;
    pump();
  }
}

/** What the service made of an upload: this item's drive, or items for each of its drives and files. */
async function settle(item: Item, { drives, left_out }: Accepted): Promise<void> {
  item.sent.value = item.size;
  const [only] = drives;
  if (drives.length === 1 && only && item.instead === null && item.archive === "") {
    item.leftOut.value = left_out;
    await become(item, only);
    return;
  }
  const shown = new Set(items.value.map((one) => one.driveId));
  const fresh = drives.filter((drive) => item.instead === null || !shown.has(drive.id));
  const part = (name: string) => new Item(item.files, item.query, name, undefined, item.archive);
  const parts = fresh.map((drive) => part(drive.files.join(", ")));
  const told = item.instead === null ? left_out.filter((file) => file.file !== item.list?.name) : [];
  const none = told.map((file) => {
    const one = part(file.file);
    one.leftOut.value = [file];
    one.problem.value = new ApiProblem(0, "", inWords(file.reason, file.said));
    one.phase.value = "refused";
    return one;
  });
  await Promise.all(parts.map((part, k) => become(part, fresh[k] as Uploaded)));
  items.value = items.value.flatMap((one) => (one === item ? [...parts, ...none] : [one]));
  if (item.instead !== null) await removeAfter(item.instead);
}

async function become(item: Item, drive: Uploaded): Promise<void> {
  item.known.value = drive.known;
  item.unclear.value = drive.unclear;
  item.driveId = drive.id;
  // Of a drive that waits there is no more to be known; those that follow it tell the rest.
  if (drive.status === "queued") item.phase.value = "queued";
  else tell(item, await getDrive(drive.id));
}

/** Send the files again, for several drives in the place of the one that they were taken for. */
export function takeApart(item: Item): void {
  const query = new URLSearchParams(item.query);
  query.set("grouping", "apart");
  const again = new Item(item.files, query);
  again.columns = item.columns;
  again.instead = item;
  item.unclear.value = [];
  items.value = items.value.flatMap((one) => (one === item ? [one, again] : [one]));
  pump();
}

async function removeAfter(item: Item): Promise<void> {
  if (!item.known.value) await removeDrive(item);
  if (item.known.value || item.phase.value === "cancelled") remove(item);
}

function fail(item: Item, error: unknown): void {
  const again = error instanceof Refusal ? error.againAfterS : null;
  if (again !== null && item.tries < TRIES) {
    item.notBefore = Date.now() + again * 1000;
    item.phase.value = "waiting";
    setTimeout(pump, again * 1000 + 10);
    return;
  }
  item.sent.value = 0;
  const problem = problemIn(error);
  if (item.archive && item.files.length > 1 && UNUSED.includes(problem.status) && problem.status !== 0) {
    oneByOne(item);
    return;
  }
  item.problem.value = problem;
  item.phase.value = "refused";
}

/** Why an upload did not come to anything; what is no refusal is a file that could not be unpacked. */
function problemIn(error: unknown): ApiProblem {
  if (error instanceof Refusal) return error.problem;
  return error instanceof ApiProblem ? error : new ApiProblem(0, "", t("upload.unpackable"));
}

/** None of the files of a run is a log that is wanted: each says by itself why. */
function oneByOne(item: Item): void {
  const each = item.files.map((file) => new Item([file], item.query, "", undefined, item.archive, item.list));
  items.value = items.value.flatMap((one) => (one === item ? each : [one]));
}

/** Take an item off the list; a transfer that is under way ends. What became a drive stays one. */
export function remove(item: Item): void {
  items.value = items.value.filter((one) => one !== item);
  item.transfer?.cancel();
  follower.arrange();
  pump();
}

/** Take off all that is over and well. */
export function removeDone(): void {
  items.value = items.value.filter((item) => item.phase.value !== "done" && item.phase.value !== "cancelled");
}

/** Try again what did not come to its end: the transfer, or the processing. */
export async function retry(item: Item): Promise<void> {
  item.tries = 0;
  item.notBefore = 0;
  if (item.phase.value === "refused") {
    item.problem.value = null;
    item.phase.value = "waiting";
    pump();
    return;
  }
  const path = { drive_id: item.driveId };
  try {
    await got(api.POST("/v1/drives/{drive_id}/reprocess", { params: { path } }));
    tell(item, await getDrive(path.drive_id));
    follower.arrange();
  } catch (error) {
    tellError(error);
  }
}

/** Whether it can come to something when it is tried again: no file becomes a log by that. */
export function mayRetry(item: Item): boolean {
  if (item.phase.value === "refused") return item.part === "" && !isLeftOut(item);
  return item.phase.value === "failed" && !(item.drive.value && isNoLog(item.drive.value));
}

/** The same for all of them, one after the other. */
export async function retryAll(): Promise<void> {
  for (const item of items.value) if (mayRetry(item)) await retry(item);
}

/** Remove the drive from the service. */
export async function removeDrive(item: Item): Promise<void> {
  const path = { drive_id: item.driveId };
  try {
    await got(api.DELETE("/v1/drives/{drive_id}", { params: { path } }));
    item.phase.value = "cancelled";
    follower.arrange();
  } catch (error) {
    tellError(error);
  }
}

/** Asks for what the page of a drive shows, again where it changes, and follows a drive that waits or runs. */
import { batch } from "@preact/signals";
import { goTo } from "../shared/address";
import { ApiProblem } from "../shared/api";
import { errorText, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import {
  addressOf,
  type Drive,
  isComputed,
  loadDrive,
  loadProfile,
  loadSegments,
  loadSensors,
  loadTrials,
  orMissing,
  POINTS,
} from "./data";
import { chosen, showChosen } from "./ride";
import {
  drive,
  fullProfile,
  link,
  other,
  problem,
  profile,
  removed,
  segments,
  sensors,
  trials,
  wanted,
} from "./state";

const POLL_MS = 2000;
const WAITS_MS = 3000;
/** From this share of the axis on a closer look is worth all rows. */
const CLOSE = 0.3;

/** The drive that the address names. */
export const driveId = decodeURIComponent(location.pathname.split("/")[2] ?? "");

const ENDED = new Set(["done", "failed"]);

/** Show what the last successful run left. */
async function showResult(): Promise<void> {
  const address = addressOf(driveId);
  // Nothing waits for the slower ones: charts are drawn at once, and each other part when it comes.
  const slow = Promise.all([loadSegments(address), loadSensors(address)]);
  profile.value = await orMissing(loadProfile(address, POINTS), null);
  const [rows, readings] = await slow;
  batch(() => {
    segments.value = rows;
    sensors.value = readings;
  });
  await loadFullProfile();
  await showOther();
}

/** Show what the address asks for beside it. */
async function showOther(): Promise<void> {
  const one = wanted.peek();
  if (one === null) {
    other.value = null;
    return;
  }
  const { kind, id } = one;
  const address = kind === "trial" ? addressOf(driveId, `/trials/${encodeURIComponent(id)}`) : addressOf(id);
  try {
    const [theirs, rows, name] = await Promise.all([
      loadProfile(address, POINTS),
      loadSegments(address),
      kind === "trial" ? trialName(id) : loadDrive(id).then((drive) => drive.filename),
    ]);
    // By now something else may be asked for.
    if (wanted.peek() === one) other.value = { kind, id, name, profile: theirs, segments: rows };
  } catch (error) {
    if (wanted.peek() !== one) return;
    other.value = null;
    tellError(new ApiProblem(0, "", t("drive.compare.failed", { why: errorText(error) })));
  }
}

async function trialName(id: string): Promise<string> {
  const one = (await loadTrials(driveId)).find((trial) => trial.id === id);
  return one ? one.method : t("drive.compare.trial");
}

/** Show another estimate beside, or none; in place of what is there no more. */
export function compareWith(kind: "drive" | "trial" | null, id = "", inPlace = false): void {
  const here = new URL(location.href);
  here.searchParams.delete("with");
  here.searchParams.delete("trial");
  if (kind) here.searchParams.set(kind === "drive" ? "with" : "trial", id);
  goTo(here.href, inPlace);
}

let asked: Promise<void> | null = null;

/** All rows of the profile, for the map at once: a thinned track cuts corners. */
function loadFullProfile(): Promise<void> {
  const now = profile.peek();
  if (!now) return Promise.resolve();
  // The service thins to so many rows at most, and leaves alone what has fewer.
  if ((drive.peek()?.epochs ?? 0) <= POINTS) {
    fullProfile.value = now;
    return Promise.resolve();
  }
  asked ??= loadProfile(addressOf(driveId), 0).then((all) => {
    fullProfile.value = all;
    refineOnZoom(link.range.peek());
  });
  return asked;
}

/** Charts get all rows, too. */
export async function drawFullProfile(): Promise<void> {
  await loadFullProfile();
  if (fullProfile.peek()) profile.value = fullProfile.peek();
}

/** Draw all rows as soon as somebody looks closely. */
export function refineOnZoom(range: [number, number] | null): void {
  const all = profile.peek()?.distance_m;
  if (!range || !all || all.length < 2) return;
  const length = (all[all.length - 1] as number) - (all[0] as number);
  if (range[1] - range[0] < CLOSE * length && fullProfile.peek()) profile.value = fullProfile.peek();
}

let stopFollowing: (() => void) | null = null;

/** The drive is removed: say so, and ask for nothing of it any more. */
export function leave(): void {
  stopFollowing?.();
  removed.value = true;
}

/** Follow the drive until it has ended; the service ends the stream itself. */
function followDrive(): void {
  stopFollowing?.();
  const source = new EventSource(addressOf(driveId, "/events"));
  stopFollowing = () => source.close();
  source.addEventListener("drive", (event) => {
    const now = JSON.parse((event as MessageEvent<string>).data) as Drive;
    const before = drive.peek();
    drive.value = now;
    if (isComputed(now) && before && !isComputed(before)) void again();
    if (!ENDED.has(now.status)) return;
    source.close();
    if (now.status === "done" || now.waits_for) void again();
    if (now.waits_for) lookLater();
  });
  source.addEventListener("deleted", leave);
  source.addEventListener("error", () => {
    // Too many streams, or none goes through: ask every few seconds.
    if (source.readyState === EventSource.CLOSED) setTimeout(() => void look(), POLL_MS);
  });
}

/** The result as it is now, after a run. */
async function again(): Promise<void> {
  asked = null;
  link.range.value = null;
  await showResult().catch(tellError);
  if (chosen.peek()) showChosen();
}

/** Look at the drive, and follow it where it has not ended. */
export async function look(): Promise<void> {
  if (removed.peek()) return;
  const waited = drive.peek()?.waits_for ?? null;
  try {
    drive.value = await loadDrive(driveId);
    problem.value = null;
  } catch (error) {
    if (error instanceof ApiProblem && error.status === 404 && drive.peek()) leave();
    else problem.value = error;
    return;
  }
  if (!ENDED.has(drive.value.status)) followDrive();
  else if (drive.value.waits_for) lookLater();
  else if (waited) await again();
}

let later = 0;

/** What the drive waits for may be there, which nobody tells. */
function lookLater(): void {
  clearTimeout(later);
  later = window.setTimeout(() => void look(), WAITS_MS);
}

let polling = false;

/** Trials as they are; asked for again while one is being made. */
export async function lookAtTrials(): Promise<void> {
  if (removed.peek()) return;
  trials.value = await loadTrials(driveId).catch(() => trials.peek());
  if (polling || !trials.value.some((one) => one.status === "queued" || one.status === "running")) return;
  polling = true;
  setTimeout(() => {
    polling = false;
    void lookAtTrials();
  }, POLL_MS);
}

/** Begin. */
export async function open(): Promise<void> {
  await look();
  const now = drive.value;
  if (!now) return;
  if (now.report !== null || now.waits_for) await showResult().catch(tellError);
  if (now.status === "done") await lookAtTrials();
}

wanted.subscribe(() => {
  if (profile.peek()) void showOther();
});
link.range.subscribe(refineOnZoom);

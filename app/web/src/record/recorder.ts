/** A recording under way: what the sensors give is counted, shown, and kept every few seconds. */
import { signal } from "@preact/signals";
import { tellTabs } from "../shared/tabs";
import { Counting, GAP_MS, NOTHING, type Totals } from "./figures";
import { Keeper, type Recording } from "./keeper";
import type { Fix } from "./samples";
import {
  altitudesOf,
  keepScreenOn,
  type LockState,
  type MotionState,
  type Trouble,
  watchMotion,
  watchPositions,
} from "./sensors";
import { shelf } from "./shelf";

const KEEP_EVERY_MS = 5000;
const TICK_MS = 1000;
/** Only one tab of a browser records at a time. */
const LOCK = "versant:recording";

/** The recording that runs; null: none does. */
export const running = signal<Recording | null>(null);
export const totals = signal<Totals>(NOTHING);
export const fix = signal<Fix | null>(null);
export const motion = signal<MotionState>("waits");
export const screen = signal<LockState>("lost");
export const trouble = signal<Trouble>(null);
/** For how long there has been no position, where that is a gap; null: they come. */
export const silent_ms = signal<number | null>(null);
/** How long the page was out of sight, all in all. */
export const hidden_ms = signal(0);
/** Why what came could not be kept; it is tried again. */
export const unkept = signal<string | null>(null);
/** Whether another tab of this browser records. */
export const elsewhere = signal(false);

/** Ends what runs, unless what it recorded could not be kept. */
let stopping: (() => Promise<void>) | null = null;

function fresh(): Recording {
  return {
    id: crypto.randomUUID(),
    began_ms: Date.now(),
    altitudes: altitudesOf(navigator.userAgent),
    sealed: false,
    chunks: 0,
    totals: NOTHING,
  };
}

/** Look whether another tab records. */
export async function lookElsewhere(): Promise<void> {
  const locks = running.value === null ? await navigator.locks.query() : null;
  elsewhere.value = locks?.held?.some((lock) => lock.name === LOCK) ?? false;
}

/** Hold the browser's only place to record; null: another tab has it. */
function place(): Promise<(() => void) | null> {
  return new Promise((given) => {
    void navigator.locks.request(LOCK, { ifAvailable: true }, (lock) => {
      if (lock === null) return given(null);
      return new Promise<void>((leave) => given(leave));
    });
  });
}

/**
 * What changes while it runs is told to the page, and kept once the place is had. What is returned ends it and says
 * that all is kept, or says that it could not be, and lets it run on.
 */
function follow(keeper: Keeper, leaving: Promise<(() => void) | null>): () => Promise<boolean> {
  const counting = new Counting(keeper.recording.totals);
  const ran_ms = counting.totals.ran_ms;
  const began_ms = Date.now();
  let latest_ms = began_ms;
  let hiddenSince_ms: number | null = null;

  const count = () => {
    const { bytes, motions } = keeper.recording.totals;
    totals.value = { ...counting.totals, bytes, motions, ran_ms: ran_ms + Date.now() - began_ms };
  };
  const keep = async () => {
    count();
    try {
      // Where another tab has the place it is that tab which keeps.
      if ((await leaving) !== null) await keeper.keep(totals.value);
      unkept.value = null;
    } catch (error) {
      unkept.value = error instanceof Error ? error.message : String(error);
    }
    count();
    return unkept.value === null;
  };
  const onFix = (now: Fix) => {
    if (!counting.add(now)) return;
    latest_ms = Date.now();
    silent_ms.value = null;
    fix.value = now;
    keeper.addFix(now);
    count();
  };
  const onSight = () => {
    if (document.hidden) {
      hiddenSince_ms = Date.now();
      void keep();
    } else if (hiddenSince_ms !== null) {
      hidden_ms.value += Date.now() - hiddenSince_ms;
      hiddenSince_ms = null;
    }
  };
  const ends = [
    watchMotion(
      (row) => keeper.addMotion(row),
      (state) => {
        motion.value = state;
      },
    ),
    watchPositions(onFix, (what) => {
      trouble.value = what;
    }),
    keepScreenOn((state) => {
      screen.value = state;
    }),
  ];
  const ticks = setInterval(() => {
    count();
    const waited_ms = Date.now() - latest_ms;
    silent_ms.value = waited_ms > GAP_MS ? waited_ms : null;
  }, TICK_MS);
  const keeps = setInterval(() => void keep(), KEEP_EVERY_MS);
  document.addEventListener("visibilitychange", onSight);
  return async () => {
    if (!(await keep())) return false;
    clearInterval(ticks);
    clearInterval(keeps);
    document.removeEventListener("visibilitychange", onSight);
    for (const end of ends) end();
    return keep();
  };
}

/** Begin a recording, or go on with one. To be called by a press of a button, and at once: browsers ask for consent. */
export async function start(recording: Recording = fresh()): Promise<void> {
  if (running.value !== null) return;
  totals.value = recording.totals;
  fix.value = null;
  trouble.value = null;
  silent_ms.value = null;
  hidden_ms.value = 0;
  unkept.value = null;
  running.value = recording;
  const leaving = place();
  const end = follow(new Keeper(shelf, recording), leaving);
  stopping = async () => {
    if (!(await end())) return;
    stopping = null;
    (await leaving)?.();
    running.value = null;
    tellTabs();
  };
  // What is kept would else be the first to go where a device is full.
  void navigator.storage?.persist?.();
  if ((await leaving) === null) {
    await stop();
    elsewhere.value = true;
  }
}

/** End it; what was recorded is kept. */
export async function stop(): Promise<void> {
  await stopping?.();
}

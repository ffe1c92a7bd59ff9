/** The browser's sensors: positions, motion, and a screen that stays on. Each says what it does, and can be stopped. */
import { Averaging, type Fix, fixOf, type Motion } from "./samples";

/** `none`: the device or the browser has no such sensors; `refused`: somebody said no. */
export type MotionState = "waits" | "delivers" | "none" | "refused";
export type LockState = "held" | "lost" | "unsupported";
/** Why there are no positions. */
export type Trouble = "denied" | "unavailable" | null;

type Stop = () => void;
const SENSORS_WITHIN_MS = 3000;

/** Devices of Apple tell altitudes above sea level, all others above the ellipsoid, as the specification has it. */
export function altitudesOf(userAgent: string): "ellipsoid" | "sea level" {
  return /iPhone|iPad|iPod|Macintosh/.test(userAgent) ? "sea level" : "ellipsoid";
}

/** Positions as often as there are new ones. Some browsers forget a page that was out of sight: it asks anew. */
export function watchPositions(onFix: (fix: Fix) => void, onTrouble: (trouble: Trouble) => void): Stop {
  const { geolocation } = navigator;
  const watch = () =>
    geolocation.watchPosition(
      (position) => {
        onTrouble(null);
        onFix(fixOf(position, Date.now()));
      },
      (error) => onTrouble(error.code === error.PERMISSION_DENIED ? "denied" : "unavailable"),
      { enableHighAccuracy: true, maximumAge: 0 },
    );
  let watching = watch();
  const again = () => {
    if (document.hidden) return;
    geolocation.clearWatch(watching);
    watching = watch();
  };
  document.addEventListener("visibilitychange", again);
  return () => {
    document.removeEventListener("visibilitychange", again);
    geolocation.clearWatch(watching);
  };
}

interface AsksFirst {
  requestPermission?: () => Promise<"granted" | "denied">;
}

/** Forces and rates, ten a second. To be called by a press of a button: some browsers ask then, and only then. */
export function watchMotion(onMotion: (motion: Motion) => void, onState: (state: MotionState) => void): Stop {
  const averaging = new Averaging();
  let over = false;
  let felt = false;
  const hear = (event: DeviceMotionEvent) => {
    if (event.accelerationIncludingGravity?.x == null) return;
    if (!felt) onState("delivers");
    felt = true;
    const row = averaging.add(event, Date.now());
    if (row !== null) onMotion(row);
  };
  const listen = () => {
    if (over) return;
    addEventListener("devicemotion", hear);
    setTimeout(() => {
      if (!felt && !over) onState("none");
    }, SENSORS_WITHIN_MS);
  };
  if (typeof DeviceMotionEvent === "undefined") onState("none");
  else {
    onState("waits");
    const asked = (DeviceMotionEvent as unknown as AsksFirst).requestPermission?.() ?? "granted";
    Promise.resolve(asked).then(
      (answer) => (answer === "granted" ? listen() : onState("refused")),
      () => onState("refused"),
    );
  }
  return () => {
    over = true;
    removeEventListener("devicemotion", hear);
    const last = averaging.take();
    if (last !== null) onMotion(last);
  };
}

/** Keep the screen on. Browsers let it go whenever the page is out of sight: it is asked for again when it is back. */
export function keepScreenOn(onState: (state: LockState) => void): Stop {
  let held: WakeLockSentinel | null = null;
  let over = false;
  const ask = async () => {
    if (over || document.hidden || (held !== null && !held.released)) return;
    try {
      held = await navigator.wakeLock.request("screen");
    } catch {
      onState("lost"); // a battery that is low, say
      return;
    }
    if (over) return void held.release();
    onState("held");
    held.addEventListener("release", () => {
      if (!over) onState("lost");
    });
  };
  const again = () => void ask();
  if ("wakeLock" in navigator) {
    document.addEventListener("visibilitychange", again);
    again();
  } else onState("unsupported");
  return () => {
    over = true;
    document.removeEventListener("visibilitychange", again);
    void held?.release();
  };
}

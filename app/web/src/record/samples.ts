/** What a browser gives while it records: positions, and forces and turning rates in the device's axes. */

/** A position; NaN is what the browser did not tell. */
export interface Fix {
  time_ms: number;
  lat_deg: number;
  lon_deg: number;
  altitude_m: number;
  h_acc_m: number;
  v_acc_m: number;
  speed_mps: number;
  course_deg: number;
}

/** Mean force (m/s2, gravity in it) and turning rate (degrees per second) about a time; NaN where there is no gyroscope. */
export interface Motion {
  time_ms: number;
  force_x: number;
  force_y: number;
  force_z: number;
  rate_x: number;
  rate_y: number;
  rate_z: number;
}

export const FIX_COLUMNS = [
  "time_ms",
  "lat_deg",
  "lon_deg",
  "altitude_m",
  "h_acc_m",
  "v_acc_m",
  "speed_mps",
  "course_deg",
] as const satisfies readonly (keyof Fix)[];
export const MOTION_COLUMNS = [
  "time_ms",
  "force_x",
  "force_y",
  "force_z",
  "rate_x",
  "rate_y",
  "rate_z",
] as const satisfies readonly (keyof Motion)[];

/** A position's time is believed that far from the clock's: some browsers have told times of other epochs. */
const BELIEVED_MS = 3_600_000;

/** The position as the browser tells it; `now_ms` stands in for a time that cannot be. */
export function fixOf({ coords, timestamp }: GeolocationPosition, now_ms: number): Fix {
  return {
    time_ms: Math.abs(timestamp - now_ms) < BELIEVED_MS ? timestamp : now_ms,
    lat_deg: coords.latitude,
    lon_deg: coords.longitude,
    altitude_m: coords.altitude ?? Number.NaN,
    h_acc_m: coords.accuracy,
    v_acc_m: coords.altitudeAccuracy ?? Number.NaN,
    speed_mps: coords.speed ?? Number.NaN,
    course_deg: coords.heading ?? Number.NaN,
  };
}

/**
 * Sixty samples a second are more than a drive needs: each tenth of a second becomes one row, their mean.
 *
 * Axes are those that browsers use, whatever the specification said for long: alpha turns about x, beta about y,
 * gamma about z. Devices of Apple state forces with the opposite sign; the service tells by bends.
 */
export class Averaging {
  static readonly EVERY_MS = 100;
  private sums: number[] = [];
  private count = 0;
  private tenth = Number.NaN;

  /** The row of the tenth before, where this event begins another one; an event without forces is none. */
  add(event: DeviceMotionEvent, now_ms: number): Motion | null {
    const force = event.accelerationIncludingGravity;
    if (force?.x == null || force.y == null || force.z == null) return null;
    const rate = event.rotationRate;
    const tenth = Math.floor(now_ms / Averaging.EVERY_MS);
    const row = tenth === this.tenth ? null : this.take();
    this.tenth = tenth;
    const values = [now_ms, force.x, force.y, force.z, rate?.alpha, rate?.beta, rate?.gamma];
    this.sums = values.map((value, k) => (value ?? Number.NaN) + (this.sums[k] ?? 0));
    this.count += 1;
    return row;
  }

  /** What has been summed up and told to nobody. */
  take(): Motion | null {
    if (this.count === 0) return null;
    const [time_ms, ...means] = this.sums.map((sum) => sum / this.count) as [number, ...number[]];
    const [force_x, force_y, force_z, rate_x, rate_y, rate_z] = means as [
      number,
      number,
      number,
      number,
      number,
      number,
    ];
    this.sums = [];
    this.count = 0;
    return { time_ms, force_x, force_y, force_z, rate_x, rate_y, rate_z };
  }
}

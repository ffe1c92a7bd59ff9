import { expect, test } from "vitest";
import { clock } from "./clock";
import { Counting, metresBetween, NOTHING } from "./figures";
import { Averaging, type Fix, fixOf } from "./samples";
import { altitudesOf } from "./sensors";

const fix = (second: number, north_m: number, h_acc_m = 4): Fix => ({
  time_ms: 1000 * second,
  lat_deg: 49 + north_m / 111_194.93,
  lon_deg: 8.4,
  altitude_m: 100,
  h_acc_m,
  v_acc_m: 8,
  speed_mps: 10,
  course_deg: 0,
});

test("metres are those of a sphere, across the antimeridian too", () => {
  expect(metresBetween(fix(0, 0), fix(0, 1000))).toBeCloseTo(1000, 0);
  const [west, east] = [-179.999, 179.999].map((lon_deg) => ({ ...fix(0, 0), lat_deg: 0, lon_deg }));
  expect(metresBetween(west as Fix, east as Fix)).toBeCloseTo(222.4, 0);
});

test("who drives is counted, who stands is not, and no position counts twice", () => {
  const counting = new Counting(NOTHING);
  for (let second = 0; second < 60; second++) {
    expect(counting.add(fix(second, 12 * second))).toBe(true);
    expect(counting.add(fix(second, 0))).toBe(false);
  }
  expect(counting.totals.positions).toBe(60);
  expect(counting.totals.distance_m).toBeCloseTo(59 * 12, 0);
  for (let second = 60; second < 120; second++) counting.add(fix(second, 708 + 4 * (second % 2)));
  expect(counting.totals.distance_m).toBeCloseTo(59 * 12, 0);
  expect(counting.totals.gaps).toBe(0);
});

test("positions that stay away are a gap; a pause between two runs is none", () => {
  const first = new Counting(NOTHING);
  for (const second of [1, 2, 7, 13, 14, 24]) first.add(fix(second, 0));
  expect(first.totals).toMatchObject({ gaps: 2, longest_gap_ms: 10_000 });
  const second = new Counting(first.totals);
  second.add(fix(1000, 5000));
  second.add(fix(1001, 5012));
  expect(second.totals).toMatchObject({ positions: 8, gaps: 2 });
  expect(second.totals.distance_m).toBeCloseTo(12, 0);
});

const event = (x: number | null, alpha?: number) =>
  ({
    accelerationIncludingGravity: { x, y: 0, z: 9.8 },
    rotationRate: alpha === undefined ? null : { alpha, beta: 2, gamma: 3 },
  }) as unknown as DeviceMotionEvent;

test("a tenth of a second of motion becomes its mean", () => {
  const averaging = new Averaging();
  expect(averaging.add(event(1, 10), 1000)).toBeNull();
  expect(averaging.add(event(null), 1010)).toBeNull();
  expect(averaging.add(event(3, 20), 1080)).toBeNull();
  const row = averaging.add(event(5), 1100);
  expect(row).toEqual({
    time_ms: 1040,
    force_x: 2,
    force_y: 0,
    force_z: 9.8,
    rate_x: 15,
    rate_y: 2,
    rate_z: 3,
  });
  expect(averaging.take()).toMatchObject({ time_ms: 1100, force_x: 5, rate_x: Number.NaN });
  expect(averaging.take()).toBeNull();
});

test("what a browser does not tell is unknown, and a time of another epoch is not believed", () => {
  const told = {
    latitude: 49,
    longitude: 8,
    accuracy: 5,
    altitude: null,
    altitudeAccuracy: null,
    speed: 0,
    heading: null,
  };
  const position = (timestamp: number) => ({ coords: told, timestamp }) as unknown as GeolocationPosition;
  const now_ms = Date.UTC(2026, 10, 28);
  expect(fixOf(position(now_ms - 900), now_ms)).toEqual({
    time_ms: now_ms - 900,
    lat_deg: 49,
    lon_deg: 8,
    altitude_m: Number.NaN,
    h_acc_m: 5,
    v_acc_m: Number.NaN,
    speed_mps: 0,
    course_deg: Number.NaN,
  });
  expect(fixOf(position(now_ms - 978_307_200_000), now_ms).time_ms).toBe(now_ms);
});

test("devices of Apple tell heights above the sea", () => {
  expect(altitudesOf("Mozilla/5.0 (iPhone; CPU iPhone OS 18_1 like Mac OS X)")).toBe("sea level");
  expect(altitudesOf("Mozilla/5.0 (Linux; Android 15; Pixel 9) Chrome/131")).toBe("ellipsoid");
});

test("a clock runs on after an hour", () => {
  expect([clock(0), clock(61_900), clock(3_600_000 + 59_000)]).toEqual(["0:00:00", "0:01:01", "1:00:59"]);
});

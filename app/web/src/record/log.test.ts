import { unzipSync } from "fflate";
import { expect, test } from "vitest";
import { NOTHING } from "./figures";
import type { Chunk, Recording } from "./keeper";
import { fileName, fileOf, fixesOf, textsOf } from "./log";

const BEGAN_MS = Date.UTC(2026, 10, 28, 7, 30, 15, 250);
const recording: Recording = {
  id: "12ab-cd",
  began_ms: BEGAN_MS,
  altitudes: "ellipsoid",
  sealed: false,
  chunks: 2,
  totals: NOTHING,
};
const fix = (second: number, ...others: number[]) => [
  BEGAN_MS + 1000 * second,
  49.123456789,
  -8.4,
  ...others,
];
const chunks: Chunk[] = [
  {
    fixes: Float64Array.from([...fix(0, Number.NaN, 4.256, Number.NaN, Number.NaN, Number.NaN)]),
    motions: Float64Array.from([BEGAN_MS + 49.6, 0.5, -0.25, 9.8, 180, -90, 0]),
  },
  {
    fixes: Float64Array.from([...fix(1, 161.5, 3, 5, 0, 359.994), ...fix(2.5, 162, 3, 5, 12.3456, 0)]),
    motions: Float64Array.from([BEGAN_MS + 150, 1, 2, 3, Number.NaN, Number.NaN, Number.NaN]),
  },
];

test("positions are rows of the columns that Sensor Logger names, and what is unknown is empty", () => {
  expect(textsOf(recording, chunks)["Location.csv"]?.split("\n")).toEqual([
    "time,seconds_elapsed,latitude,longitude,altitude,horizontalAccuracy,verticalAccuracy,speed,bearing",
    `${BEGAN_MS}000000,0.000,49.12345679,-8.40000000,,4.26,,,`,
    `${BEGAN_MS + 1000}000000,1.000,49.12345679,-8.40000000,161.500,3.00,5.00,0.000,359.99`,
    `${BEGAN_MS + 2500}000000,2.500,49.12345679,-8.40000000,162.000,3.00,5.00,12.346,0.00`,
    "",
  ]);
});

test("the column says what altitudes are above", () => {
  const apple = textsOf({ ...recording, altitudes: "sea level" }, chunks)["Location.csv"];
  expect(apple).toContain(",longitude,altitudeAboveMeanSeaLevel,horizontalAccuracy,");
});

test("forces stay in the device's axes, rates are radians, and who has no gyroscope has no file of it", () => {
  const texts = textsOf(recording, chunks);
  expect(texts["TotalAcceleration.csv"]?.split("\n")).toEqual([
    "time,seconds_elapsed,x,y,z",
    `${BEGAN_MS + 50}000000,0.050,0.50000,-0.25000,9.80000`,
    `${BEGAN_MS + 150}000000,0.150,1.00000,2.00000,3.00000`,
    "",
  ]);
  expect(texts["Gyroscope.csv"]?.split("\n").slice(1)).toEqual([
    `${BEGAN_MS + 50}000000,0.050,3.14159,-1.57080,0.00000`,
    "",
  ]);
  const without = textsOf(recording, [{ fixes: new Float64Array(), motions: new Float64Array() }]);
  expect(Object.keys(without)).toEqual(["Location.csv"]);
});

test("the same recording is the same bytes at any time, under one name", async () => {
  const [first, second] = [fileOf(recording, chunks), fileOf(recording, chunks)];
  expect(first.name).toBe("versant-2026-11-28T07-30-15Z-12ab.zip");
  expect(first.name).toBe(fileName(recording));
  const bytes = new Uint8Array(await first.arrayBuffer());
  expect(bytes).toEqual(new Uint8Array(await second.arrayBuffer()));
  expect(Object.keys(unzipSync(bytes))).toEqual(["Location.csv", "TotalAcceleration.csv", "Gyroscope.csv"]);
  // The time in the zip's head is no time of the clock.
  expect([...bytes.slice(10, 14)]).toEqual([0, 0, 0x22, 0]);
});

test("positions come back in the order in which they came", () => {
  expect([...fixesOf(chunks)].map((one) => one.time_ms - BEGAN_MS)).toEqual([0, 1000, 2500]);
});

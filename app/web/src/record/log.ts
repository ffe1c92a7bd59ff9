/**
 * A recording as a log that the service reads: the zip of CSVs that Sensor Logger writes.
 *
 * Of the formats it is the one that holds what browsers give: positions with both accuracies, altitudes whose kind is
 * told by their column, speed and course, and forces and rates in the device's own axes, which the service turns.
 * The same recording gives the same bytes, so that what is sent twice is one drive.
 */
import { strToU8, zipSync } from "fflate";
import type { Chunk, Recording } from "./keeper";
import { FIX_COLUMNS, type Fix, MOTION_COLUMNS, type Motion } from "./samples";

const RADIANS = Math.PI / 180;
/** A zip has times of its own: always this one. */
const MTIME = "1980-01-02T00:00:00";

function* rows(packed: Float64Array, names: readonly string[]): Generator<Record<string, number>> {
  for (let at = 0; at + names.length <= packed.length; at += names.length)
    yield Object.fromEntries(names.map((name, k) => [name, packed[at + k] as number]));
}

/** The positions of chunks, in the order in which they came. */
export function* fixesOf(chunks: Iterable<Chunk>): Generator<Fix> {
  for (const { fixes } of chunks) for (const row of rows(fixes, FIX_COLUMNS)) yield row as unknown as Fix;
}

/** The forces and rates of chunks. */
export function* motionsOf(chunks: Iterable<Chunk>): Generator<Motion> {
  for (const { motions } of chunks)
    for (const row of rows(motions, MOTION_COLUMNS)) yield row as unknown as Motion;
}

const cell = (value: number, decimals: number) => (Number.isFinite(value) ? value.toFixed(decimals) : "");

/** Nanoseconds since 1970, and seconds since the beginning. */
function times(time_ms: number, began_ms: number): string {
  return `${Math.round(time_ms)}000000,${((time_ms - began_ms) / 1000).toFixed(3)}`;
}

function locations(recording: Recording, chunks: Chunk[]): string {
  const column = recording.altitudes === "ellipsoid" ? "altitude" : "altitudeAboveMeanSeaLevel";
  const lines = [
    `time,seconds_elapsed,latitude,longitude,${column},horizontalAccuracy,verticalAccuracy,speed,bearing`,
  ];
  for (const fix of fixesOf(chunks))
    lines.push(
      [
        times(fix.time_ms, recording.began_ms),
        cell(fix.lat_deg, 8),
        cell(fix.lon_deg, 8),
        cell(fix.altitude_m, 3),
        cell(fix.h_acc_m, 2),
        cell(fix.v_acc_m, 2),
        cell(fix.speed_mps, 3),
        cell(fix.course_deg, 2),
      ].join(","),
    );
  return `${lines.join("\n")}\n`;
}

function axes(recording: Recording, chunks: Chunk[], of: (motion: Motion) => number[]): string {
  const lines = ["time,seconds_elapsed,x,y,z"];
  for (const motion of motionsOf(chunks)) {
    const values = of(motion);
    if (!values.every(Number.isFinite)) continue;
    const written = values.map((value) => cell(value, 5)).join(",");
    lines.push(`${times(motion.time_ms, recording.began_ms)},${written}`);
  }
  return lines.length > 1 ? `${lines.join("\n")}\n` : "";
}

/** What the zip holds, by name; sensors that gave nothing have no file. */
export function textsOf(recording: Recording, chunks: Chunk[]): Record<string, string> {
  const texts = {
    "Location.csv": locations(recording, chunks),
    "TotalAcceleration.csv": axes(recording, chunks, (m) => [m.force_x, m.force_y, m.force_z]),
    "Gyroscope.csv": axes(recording, chunks, (m) => [m.rate_x, m.rate_y, m.rate_z].map((r) => r * RADIANS)),
  };
  return Object.fromEntries(Object.entries(texts).filter(([, text]) => text !== ""));
}

/** What the file is called: by the moment at which the recording began, in UTC, and so that no two are called the same. */
export function fileName({ id, began_ms }: Recording): string {
  const moment = new Date(began_ms).toISOString().slice(0, 19).replaceAll(":", "-");
  return `versant-${moment}Z-${id.slice(0, 4)}.zip`;
}

/** The log as a file. */
export function fileOf(recording: Recording, chunks: Chunk[]): File {
  const texts = Object.entries(textsOf(recording, chunks));
  const packed = Object.fromEntries(texts.map(([name, text]) => [name, strToU8(text)]));
  const bytes = zipSync(packed, { level: 6, mtime: MTIME });
  return new File([bytes], fileName(recording), {
    type: "application/zip",
    lastModified: recording.began_ms,
  });
}

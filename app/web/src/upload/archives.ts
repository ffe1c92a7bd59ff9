/** Archives of rides: what is in them in runs that one upload can take, and what is none of it. */
import { isHidden } from "./gathering";
import type { Packed } from "./zip";

export const MOST_OF_A_RUN = 32;
const MOST_BYTES_OF_A_RUN = 64 * 2 ** 20;
const LIST = /(^|\/)activities\.csv$/i;
const PICTURE = /\.(jpe?g|png|gif|heic|webp|mp4|mov|avi|html?|pdf)$/i;

export interface Sorted {
  /** Files of one folder, as many as one upload takes. */
  runs: Packed[][];
  /** Pictures and pages, which are not sent. */
  others: Packed[];
}

/** Whether there is more in a zip than one upload takes: many files, or zips. */
export function isArchive(files: Packed[], zip: string): boolean {
  const inner = files.some((file) => file.path.toLowerCase().includes(".zip/"));
  return files.length > MOST_OF_A_RUN || inner || (files.length > 1 && /^export_\d+\.zip$/i.test(zip));
}

/** Sort the files of an archive into runs. Those of one folder stay together as far as they can. */
export function inRuns(files: Packed[]): Sorted {
  const wanted = files.filter((file) => !file.path.split("/").some(isHidden));
  const others = wanted.filter((file) => PICTURE.test(file.name));
  const runs: Packed[][] = [];
  let last = "";
  let bytes = 0;
  for (const file of wanted.filter((one) => !PICTURE.test(one.name) && !LIST.test(one.path))) {
    const folder = file.path.slice(0, -file.name.length);
    const run = runs.at(-1);
    bytes += file.size;
    if (run && folder === last && run.length < MOST_OF_A_RUN - 1 && bytes <= MOST_BYTES_OF_A_RUN) {
      run.push(file);
      continue;
    }
    runs.push([file]);
    last = folder;
    bytes = file.size;
  }
  return { runs, others };
}

/** The rows of Strava's list that name files of a run, so that the service knows their sports. */
export function listFor(run: Packed[], list: string): File | null {
  const [header = "", ...rows] = list.split("\n");
  const named = rows.filter((row) => run.some((file) => row.includes(`activities/${file.name}`)));
  if (named.length === 0) return null;
  return new File([[header, ...named, ""].join("\n")], "activities.csv", { lastModified: 0 });
}

/** The text of Strava's list; empty without one. */
export async function listIn(files: Packed[]): Promise<string> {
  const list = files.find((file) => LIST.test(file.path));
  return list ? (await list.open()).text() : "";
}

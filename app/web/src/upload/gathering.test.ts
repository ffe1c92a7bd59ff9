import { describe, expect, it } from "vitest";
import { belongTogether, chosenFiles, isHidden } from "./gathering";
import { headerOf, missingColumns } from "./header";

describe("files", () => {
  it("leaves out what is hidden, and what lies in hidden folders", () => {
    expect([".git", "Thumbs.db", "__MACOSX", "a.csv"].map(isHidden)).toEqual([true, true, true, false]);
    const file = (name: string, path: string) =>
      Object.defineProperty(new File(["x"], name), "webkitRelativePath", { value: path });
    const given = [file("a.csv", "logs/a.csv"), file("b", "logs/.git/b"), new File(["x"], "c.gpx")];
    const { files, hidden } = chosenFiles(given);
    expect(files.map((one) => one.name)).toEqual(["a.csv", "c.gpx"]);
    expect(hidden).toBe(1);
  });

  it("asks only about files that look like parts of a recording", () => {
    expect(belongTogether(["rover.26o", "brdc.26n"], 32)).toBe(true);
    expect(belongTogether(["Location.csv", "Accelerometer.csv"], 32)).toBe(true);
    expect(belongTogether(["monday.csv", "tuesday.gpx"], 32)).toBe(false);
    expect(belongTogether(["brdc.26n"], 32)).toBe(false);
    expect(belongTogether(["a.nav", "b.obs", "c.obs"], 2)).toBe(false);
  });
});

describe("columns", () => {
  it("reads a header whatever parts its cells", () => {
    expect(headerOf('# made by x\n"when";Breite;Laenge\n1;2;3')).toEqual(["when", "Breite", "Laenge"]);
    expect(headerOf("a,b\n1,2")).toEqual(["a", "b"]);
    expect(headerOf("")).toEqual([]);
  });

  it("asks for those that a refusal names and the file lacks", () => {
    const reason = "This CSV lacks required columns: time_s or time, lat_deg. Its header names: lon_deg.";
    expect(
      missingColumns(reason, ["time", "time_s", "lat_deg", "lon_deg", "alt_msl_m"], ["lon_deg"]),
    ).toEqual(["time", "time_s", "lat_deg"]);
  });
});

import { describe, expect, it } from "vitest";
import { belongTogether, chosenFiles, isHidden } from "./gathering";

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

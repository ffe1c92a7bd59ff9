import { describe, expect, it, vi } from "vitest";
import type { LogColumn } from "./corrected";

vi.stubGlobal("location", new URL("http://127.0.0.1/upload"));
const { corrected, takenAs, twice } = await import("./corrected");

const column = (name: string, taken_as: string | null, guessed = taken_as !== null): LogColumn => ({
  name,
  taken_as,
  guessed,
  unit: null,
  values: [],
});
const OURS = ["time_s", "lat_deg", "lon_deg", "alt_msl_m", "height_ell_m", "speed_mps"];
const FILE = [
  column("Date", "date"),
  column("lat_deg", "lat_deg", false),
  column("Lng", "lon_deg"),
  column("Altitude", "alt_msl_m"),
  column("Hoehe", null),
];

describe("columns", () => {
  it("that stay are not said", () => {
    expect(corrected(FILE, {}, OURS, {})).toEqual({});
  });

  it("that are something else are said, with what the file has no more", () => {
    expect(corrected(FILE, { Altitude: "height_ell_m" }, OURS, {})).toEqual({
      height_ell_m: "Altitude",
      alt_msl_m: "-",
    });
    expect(corrected(FILE, { Altitude: "", Hoehe: "alt_msl_m" }, OURS, {})).toEqual({ alt_msl_m: "Hoehe" });
    expect(corrected(FILE, { lat_deg: "lon_deg", Lng: "lat_deg" }, OURS, {})).toEqual({
      lat_deg: "Lng",
      lon_deg: "lat_deg",
    });
  });

  it("keep what was said before", () => {
    const said = [column("Hoehe", "alt_msl_m", false), column("Speed", null)];
    const had = { alt_msl_m: "Hoehe", speed_mps: "-" };
    expect(corrected(said, {}, OURS, had)).toEqual(had);
    expect(corrected(said, { Speed: "speed_mps" }, OURS, had)).toEqual({
      alt_msl_m: "Hoehe",
      speed_mps: "Speed",
    });
  });

  it("are one thing each", () => {
    expect(twice(FILE, { Hoehe: "alt_msl_m" })).toEqual(["alt_msl_m"]);
    expect(twice(FILE, { Hoehe: "alt_msl_m", Altitude: "" })).toEqual([]);
    // Two clocks of one file are the file's affair.
    expect(twice([column("GPS Time", "time_s"), column("Device Time", "time_s")], {})).toEqual([]);
    expect(takenAs(column("x", null), {})).toBe("");
  });
});

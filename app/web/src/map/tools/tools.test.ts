import { describe, expect, it, vi } from "vitest";
import type { Segment } from "../../segment/data";
import type { Position } from "../state";
import { lengthOf } from "./length";
import { decoded, encoded, MOST_CHARACTERS } from "./polyline";
import { streetsOf } from "./streets";

vi.stubGlobal("addEventListener", () => undefined);
vi.stubGlobal("location", { search: "", hash: "", origin: "http://127.0.0.1", pathname: "/map" });
vi.stubGlobal("document", { querySelector: () => null, documentElement: { dataset: {} } });
vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener: () => undefined }));
const { address, parsed } = await import("../state");

const LINE: Position[] = [
  [-120.2, 38.5],
  [-120.95, 40.7],
  [-126.453, 43.252],
];

describe("a line as a text", () => {
  it("is Google's polyline", () => {
    expect(encoded(LINE)).toBe("_p~iF~ps|U_ulLnnqC_mqNvxq`@");
    expect(decoded(encoded(LINE))).toEqual(LINE);
  });
  it("holds a line that people draw in what an address takes", () => {
    const drawn = Array.from({ length: 150 }, (_, n): Position => [8.4 + n * 0.002, 49 - n * 0.001]);
    expect(encoded(drawn).length).toBeLessThan(MOST_CHARACTERS);
    expect(decoded(encoded(drawn)).at(-1)).toEqual([8.698, 48.851]);
  });
  it("is none where it breaks off, is no code, or leaves the Earth", () => {
    for (const text of [
      "",
      "_p~iF",
      "_p~iF~ps|U",
      "a b",
      "_p~iF~ps|U_",
      encoded([LINE[0] as Position, [0, 95]]),
    ])
      expect(decoded(text)).toEqual([]);
  });
  it("is in the address with the profile alone", () => {
    const state = { ...parsed("?tool=profile"), line: encoded(LINE) };
    expect(parsed(address(state, "")).line).toBe(encoded(LINE));
    expect(address({ ...state, tool: "steepest" }, "")).toBe("?tool=steepest");
    expect(parsed("?tool=other&line=abc")).toMatchObject({ tool: null, line: "" });
  });
  it("is as long as on the Earth", () => {
    expect(
      lengthOf([
        [8, 49],
        [8, 50],
      ]),
    ).toBeCloseTo(111_195, -1);
    expect(
      lengthOf([
        [8, 60],
        [9, 60],
      ]),
    ).toBeCloseTo(55_597, -1);
  });
});

describe("streets", () => {
  const segment = (id: number, name: string | null, slope: number | null, sigma: number, way = 1) =>
    ({
      id,
      properties: {
        name,
        osm_way_id: way,
        highway: "track",
        length_m: 40,
        slope_percent: slope,
        slope_sigma_percent: sigma,
      },
      geometry: { coordinates: [] },
    }) as unknown as Segment;
  it("are one line each, by their steepest segment", () => {
    const streets = streetsOf([
      segment(1, "A", -12, 0.5),
      segment(2, "B", 11, 0.5),
      segment(3, "A", 10, 0.5),
      segment(4, null, 9, 0.5, 7),
      segment(5, null, 8, 0.5, 7),
      segment(6, null, 7, 0.5, 8),
    ]);
    expect(streets.map(({ id, steepness_percent }) => [id, steepness_percent])).toEqual([
      [1, 12],
      [2, 11],
      [4, 9],
      [6, 7],
    ]);
  });
  it("are no doubtful ones, but for what is sure of them", () => {
    expect(
      streetsOf([segment(1, "A", 12, 5), segment(2, "A", 6, 1), segment(3, "B", null, 1)]).map(
        ({ id }) => id,
      ),
    ).toEqual([2]);
  });
});

import { describe, expect, it, vi } from "vitest";

vi.stubGlobal("addEventListener", () => undefined);
vi.stubGlobal("location", { search: "", hash: "", origin: "http://127.0.0.1", pathname: "/map" });
vi.stubGlobal("document", { querySelector: () => null, documentElement: { dataset: {} } });
vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener: () => undefined }));

const { address, parsed } = await import("./state");
const { counted } = await import("./count");
const { lettersOf, over } = await import("./background");
const { Freshness } = await import("./live");
const { nearest } = await import("./picking");
const { shows, tileOf, tileUrl, tilesOver } = await import("./tiles");

describe("the address", () => {
  it.each([
    "",
    "?at=14.20/49.41000/8.69000&segment=17&colour=difference&classes=unknown,5,8&sigma=0.5&drives=2",
    "?at=9.00/-17.00000/179.99000&layer=ways",
    "?way=3",
    "?lang=de&way=3&layer=segments",
  ])("says %s as it was read", (search) => {
    expect(address(parsed(search), search).split("&").sort()).toEqual(search.split("&").sort());
  });
  it.each([
    "?at=x/1/2",
    "?at=3/91/2",
    "?at=1/2",
    "?segment=-1&sigma=-2&drives=x&colour=blue&layer=roads",
    "?classes=,x",
  ])("takes no nonsense from %s", (search) => expect(address(parsed(search), search)).toBe(""));
});

describe("tiles", () => {
  it("are known by their addresses", () => {
    const tile = { z: 14, x: 8579, y: 5634 };
    for (const layer of ["segments", "ways"] as const) expect(tileOf(tileUrl(layer, tile))).toEqual(tile);
    expect(tileOf("/tiles.json")).toBeNull();
  });
  it("cover a box, and show what changed beyond their edge", () => {
    expect(tilesOver([-10, 10, 10, 20], 1)).toEqual([
      { z: 1, x: 0, y: 0 },
      { z: 1, x: 1, y: 0 },
    ]);
    const tile = { z: 1, x: 0, y: 0 };
    expect(shows(tile, [0.5, 10, 20, 20])).toBe(true);
    expect(shows(tile, [20, 10, 30, 20])).toBe(false);
    expect(shows(tile, null)).toBe(true);
  });
  it("are old where something changed after they were fetched", () => {
    const fresh = new Freshness();
    const [west, east] = [
      { z: 1, x: 0, y: 0 },
      { z: 1, x: 1, y: 0 },
    ];
    expect(fresh.old([west, east])).toEqual([]);
    fresh.changed([20, 10, 30, 20]);
    expect(fresh.old([west, east])).toEqual([east]);
    fresh.asked(east);
    expect(fresh.old([west, east])).toEqual([]);
    fresh.changed(null);
    expect(fresh.old([west, east])).toEqual([west, east]);
  });
});

describe("counting", () => {
  const roads = {
    ids: Float64Array.of(1, 2, 3, 4),
    slope: Float32Array.of(-5, 0.5, Number.NaN, 5),
    sigma: Float32Array.of(0.2, 2, Number.NaN, 0.2),
    drives: Float32Array.of(3, 1, 0, 1),
    modelled: Float32Array.of(-4, Number.NaN, 2, 5),
    boxes: Float32Array.of(0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 3, 3, 4, 4),
  };
  const asked = {
    number: 1,
    tiles: [],
    anew: [],
    archive: null,
    box: [0, 0, 1, 1] as [number, number, number, number],
    colour: "steepness" as const,
    breaks: [0, 4],
    classes: [] as number[],
    mostSigma: null as number | null,
    leastDrives: 0,
    unknown: true,
  };
  const tile = { z: 0, x: 0, y: 0 };
  const count = (more: object) =>
    counted(
      { ...asked, ...more },
      [
        { tile, roads },
        { tile, roads },
      ],
      () => [0, 0, 1, 1],
    );

  it("takes a road once and leaves out what is not in view", () => {
    expect(count({})).toMatchObject({ all: 3, shown: 3, each: [1, 1], unknown: 1, measured: 2 });
  });
  it("filters as the map does", () => {
    expect(count({ classes: [1], unknown: false })).toMatchObject({ shown: 1, each: [1, 1] });
    expect(count({ mostSigma: 1, unknown: false })).toMatchObject({ shown: 1, each: [0, 1] });
    expect(count({ leastDrives: 4, unknown: false })).toMatchObject({ shown: 0 });
    expect(count({ colour: "elevation-model" })).toMatchObject({ each: [1, 1], unknown: 1 });
    expect(count({ colour: "difference" })).toMatchObject({ each: [1, 0], unknown: 2 });
  });
});

it("the nearest road is meant", () => {
  const line = (id: number, y: number) => ({
    id,
    geometry: {
      type: "LineString" as const,
      coordinates: [
        [0, y],
        [10, y],
      ],
    },
  });
  const project = ([x, y]: [number, number]) => ({ x, y });
  expect(nearest([line(1, 0), line(2, 5)], { x: 5, y: 3 }, project)).toBe(2);
  expect(nearest([], { x: 5, y: 3 }, project)).toBeNull();
});

it("a background lies below, with letters and signs of its own", () => {
  const roads = {
    version: 8 as const,
    glyphs: "http://here/glyphs/{fontstack}/{range}.pbf",
    sprite: "http://here/sprites/versant",
    sources: { slopes: { type: "vector" as const, url: "http://here/tiles.json" } },
    layers: [
      { id: "ground", type: "background" as const },
      { id: "uphill", type: "symbol" as const, source: "slopes", layout: { "icon-image": "uphill" } },
      { id: "places", type: "symbol" as const, source: "names", layout: { "text-field": "a" } },
    ],
  };
  const land = { id: "ground", type: "fill" as const, source: "slopes", "source-layer": "land" };
  const below = {
    version: 8 as const,
    glyphs: "http://there/{fontstack}/{range}.pbf",
    sprite: "http://there/sprite",
    sources: { slopes: { type: "vector" as const } },
    layers: [land],
  };
  const both = over(below, roads);
  expect(both.layers.map((one) => one.id)).toEqual(["background:ground", "uphill", "places"]);
  expect(both.layers[0]).toMatchObject({ source: "background:slopes" });
  expect(both.layers[1]).toMatchObject({ layout: { "icon-image": "versant:uphill" } });
  expect(Object.keys(both.sources)).toEqual(["background:slopes", "slopes"]);
  // Its names would be there twice.
  const towns = { id: "towns", type: "symbol" as const, source: "slopes", layout: { "text-field": "a" } };
  for (const lettered of [towns, { id: "picture", type: "raster" as const, source: "slopes" }])
    expect(over({ ...below, layers: [land, lettered] }, roads).layers.map((one) => one.id)).toEqual([
      "background:ground",
      `background:${lettered.id}`,
      "uphill",
    ]);
  const fonts = new Set(["DejaVu Sans"]);
  expect(lettersOf("http://there/DejaVu%20Sans/0-255.pbf", roads.glyphs, fonts)).toBe(
    "http://here/glyphs/DejaVu%20Sans/0-255.pbf",
  );
  expect(lettersOf("http://there/Noto/0-255.pbf", roads.glyphs, fonts)).toBeNull();
});

import { expect, test } from "vitest";
import { begins, exactly, fromName, meaning } from "./finding";
import { compass, share } from "./words";

test.each([
  ["49.41, 8.69", 49.41, 8.69],
  ["49.41,8.69", 49.41, 8.69],
  ["49.41 8.69", 49.41, 8.69],
  ["49,41 8,69", 49.41, 8.69],
  ["49,41; 8,69", 49.41, 8.69],
  ["-33.9, 151.2", -33.9, 151.2],
  ["151.2, -33.9", -33.9, 151.2],
  ["8.69 E 49.41 N", 49.41, 8.69],
  ["N 49.41 E 8.69", 49.41, 8.69],
  ["49° 24' 36\" N, 8° 41' 24\" E", 49.41, 8.69],
  ["49°24.6'N 8°41.4'E", 49.41, 8.69],
  ["33°54'S 151°12'E", -33.9, 151.2],
  ["geo:49.41,8.69", 49.41, 8.69],
  ["https://www.openstreetmap.org/#map=17/49.41/8.69", 49.41, 8.69],
  ["https://www.openstreetmap.org/?mlat=49.41&mlon=8.69#map=12/1/2", 49.41, 8.69],
])("the place %s", (text, lat, lon) => {
  const place = meaning(text);
  expect(place?.kind).toBe("place");
  if (place?.kind !== "place") return;
  expect(place.lat).toBeCloseTo(lat, 6);
  expect(place.lon).toBeCloseTo(lon, 6);
});

test.each([
  ["segment 17", { kind: "segment", id: 17 }],
  ["Abschnitt #17", { kind: "segment", id: 17 }],
  ["way 4711", { kind: "way", id: 4711 }],
  ["https://www.openstreetmap.org/way/4711#map=17/1/2", { kind: "way", id: 4711 }],
  ["4711", { kind: "number", id: 4711 }],
  ["Hauptstraße", { kind: "name", name: "Hauptstraße" }],
  ["  B  3 ", { kind: "name", name: "B 3" }],
  ["Am", { kind: "wrong", why: "short" }],
  ["95, 200", { kind: "wrong", why: "place" }],
  ["1.5", { kind: "wrong", why: "place" }],
  ["0", { kind: "wrong", why: "number" }],
  ["https://www.openstreetmap.org/node/1", { kind: "wrong", why: "node" }],
])("%s means", (text, expected) => expect(meaning(text)).toEqual(expected));

test("nothing means nothing", () => expect(meaning("  ")).toBeNull());

test("names are text in a filter", () => {
  expect(exactly("o'Connell")).toBe("name IN ('o''Connell', 'O''Connell')");
  expect(fromName("haupt", null)).toBe("name >= 'Haupt'");
  expect(fromName("haupt", "Haupt'weg")).toBe("name > 'Haupt''weg'");
  expect([begins("Hauptweg", "haupt"), begins("Haus", "haupt")]).toEqual([true, false]);
});

test("points of the compass", () => {
  const from: [number, number] = [8, 49];
  expect(compass(from, [8, 50])).toBe("n");
  expect(compass(from, [8.1, 49])).toBe("e");
  expect(compass(from, [7.9, 48.93])).toBe("sw");
  expect(compass([179.99, 0], [-179.99, 0])).toBe("e");
});

test("little is not nothing", () => {
  expect([0, 0.001, 0.5, 0.999, 1, null].map(share)).toEqual([
    "0 %",
    "< 1 %",
    "50 %",
    "> 99 %",
    "100 %",
    "–",
  ]);
});

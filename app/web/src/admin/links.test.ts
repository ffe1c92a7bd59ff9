import { expect, test, vi } from "vitest";

vi.stubGlobal("location", new URL("http://127.0.0.1:8000/admin"));
const { boxOfTile, drivesPage, mapOfBox, ownAddress, roadsOf } = await import("./links");

test("only addresses of this service are followed", () => {
  expect(ownAddress("/drives?status=failed")).toBe("/drives?status=failed");
  expect(ownAddress("http://127.0.0.1:8000/v1/webhooks")).toBe("/v1/webhooks");
  for (const text of ["https://elsewhere.example/x", "//elsewhere.example", "javascript:alert(1)", "", null])
    expect(ownAddress(text)).toBeNull();
});

test("what is unknown is left out of an address", () => {
  expect(drivesPage({ status: "failed", failure: null })).toBe("/drives?status=failed");
  expect(drivesPage()).toBe("/drives");
  expect(roadsOf("it's", true)).toContain(encodeURIComponent("'it''s'").replaceAll("'", "%27"));
});

test("the map shows a tile, and a box across the antimeridian", () => {
  const [west, south, east, north] = boxOfTile("12/2143/1406");
  expect(west).toBeCloseTo(8.349609, 5);
  expect(east - west).toBeCloseTo(360 / 4096, 8);
  expect(north).toBeGreaterThan(south);
  expect(mapOfBox([179.9, -17, -179.9, -16.9])).toBe("/map?bbox=179.9,-17,-179.9,-16.9");
  expect(mapOfBox([8.4, 49, 8.5, 49.1], "difference")).toBe("/map?bbox=8.4,49,8.5,49.1&colour=difference");
});

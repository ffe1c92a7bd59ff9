import { expect, it, vi } from "vitest";
import { choiceOf, daysOf, isShorter } from "./keeping";

vi.stubGlobal("location", new URL("http://127.0.0.1/owner?owner=7"));
vi.stubGlobal("document", { querySelector: () => null });
const { ARCHIVE, featuresOf, zonesOf } = await import("./state");

it.each([null, 0, 1, 30])("%j days are chosen and said back", (days) =>
  expect(daysOf(choiceOf(days), String(days))).toBe(days),
);

it.each([
  [0, null, true],
  [30, null, true],
  [7, 30, true],
  [30, 7, false],
  [7, 7, false],
  [null, 7, false],
])("from %j to %j deletes something: %j", (wanted, now, shorter) =>
  expect(isShorter(wanted, now)).toBe(shorter),
);

it("gives zones back as they came", () => {
  const zone = {
    type: "Feature" as const,
    geometry: { type: "Point" as const, coordinates: [8.6724, 49.4102] as [number, number] },
    properties: { name: "home", radius_m: 300 },
  };
  expect(featuresOf(zonesOf([zone]))).toEqual([zone]);
});

it("is about the owner that the address names", () => expect(ARCHIVE).toBe("/v1/owners/7/archive"));

import { expect, test, vi } from "vitest";
import { creditLine, creditsIn, withCredits } from "./credit";

vi.mock("./api", () => ({ getJson: undefined })); // it needs a page

const ALL = [
  { credit: "north.tif", boxes: [[8, 50, 9, 51]] as [number, number, number, number][] },
  { credit: "A & B (CC BY 4.0)", boxes: [[8, 48, 9, 49]] as [number, number, number, number][] },
];
const ROADS = '<a href="https://www.openstreetmap.org/copyright">© OpenStreetMap contributors</a>';

test("only what lies under the view is named", () => {
  expect(creditsIn(ALL, [8.4, 48.5, 8.5, 48.6])).toEqual(["A & B (CC BY 4.0)"]);
  expect(creditsIn(ALL, [8.4, 48.5, 8.5, 50.6])).toEqual(["north.tif", "A & B (CC BY 4.0)"]);
  expect(creditsIn(ALL, [1, 48.5, 2, 50.6])).toEqual([]);
});

test("the roads are always named, and what is said is no markup", () => {
  const whole = `${ROADS}, elevation from north.tif, A &amp; B (CC BY 4.0)`;
  expect(withCredits(whole, ["A & B (CC BY 4.0)"])).toBe(`${ROADS}, elevation from A &#38; B (CC BY 4.0)`);
  expect(withCredits(whole, [])).toBe(ROADS);
  expect(withCredits(ROADS, ["x"])).toBe(ROADS);
});

test("the line of a document is said in the page's language, and its parts stay", () => {
  const roads = "Roads © OpenStreetMap contributors, Open Database License (ODbL) 1.0";
  expect(creditLine(roads)).toBe(roads);
  expect(creditLine(`${roads}; elevation from A; B`)).toBe(`${roads}; elevation from A; B`);
});

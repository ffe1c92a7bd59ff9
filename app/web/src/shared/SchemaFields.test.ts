import { expect, it, vi } from "vitest";
import { chosenQuery, type Methods, USUAL, usable } from "./methods";
import { allowed, range } from "./SchemaFields";

vi.mock("./api", () => ({ api: {}, got: undefined })); // it needs a page

const bounded = { type: "number", exclusiveMinimum: 0, maximum: 10 };

it("holds values to their range", () => {
  expect([0, 0.1, 10, 11, Number.NaN].map((value) => allowed(bounded, value))).toEqual([
    false,
    true,
    true,
    false,
    false,
  ]);
  expect(allowed({ type: "integer" }, 1.5)).toBe(false);
  expect(allowed({ anyOf: [bounded, { type: "null" }] }, 20)).toBe(false);
  expect(range(bounded)).toBe("> 0, ≤ 10");
});

it("says in a query only what was chosen", () => {
  const known = {
    default: "profile",
    default_positioning: "auto",
    methods: [{ name: "profile", options: { properties: { match_radius_m: bounded } } }],
    positionings: [],
  } as unknown as Methods;
  expect(String(chosenQuery(USUAL, known))).toBe("");
  const chosen = { ...USUAL, options: { match_radius_m: 5 }, gnss: "ekf", gnssOptions: { tau_s: 2 } };
  expect([...chosenQuery(chosen, known)]).toEqual([
    ["method", "profile"],
    ["option", "match_radius_m:5"],
    ["gnss", "ekf"],
    ["gnss_option", "tau_s:2"],
  ]);
  expect(usable(chosen, known)).toBe(true);
  expect(usable({ ...chosen, options: { match_radius_m: 50 } }, known)).toBe(false);
});

import { expect, it } from "vitest";
import { linkOf, returnTo } from "./returning";

const HERE = "https://slopes.example";
const asked = (path: string) => returnTo(`?${new URLSearchParams({ return_to: path })}`, HERE);

it.each([
  "/",
  "/map",
  "/map?at=14.20/49.41000/8.69000&segment=17#there",
  "/drives/17?with=18",
  "/map?next=https://elsewhere.example/",
  "/map?next=//elsewhere.example",
  "/login/else",
])("goes on to %s", (path) => expect(asked(path)).toBe(path));

it.each([
  "",
  "map",
  "https://elsewhere.example/map",
  `${HERE}/map`,
  "//elsewhere.example",
  "///elsewhere.example",
  "/\\elsewhere.example",
  "\\/elsewhere.example",
  "\\\\elsewhere.example",
  "/\t/elsewhere.example",
  "/\n/elsewhere.example",
  "/\r\\elsewhere.example",
  "/\u0000/elsewhere.example",
  " //elsewhere.example",
  "/.//elsewhere.example",
  "/map/..//elsewhere.example",
  "/%2e//elsewhere.example",
  "javascript:alert(1)",
  "data:text/html,x",
  "@elsewhere.example",
  ":80@elsewhere.example",
  "/login",
  "/login?return_to=/map",
  "/./login",
])("does not go on to %j", (path) => expect(asked(path)).toBeNull());

it("goes nowhere where nothing is said, and takes the first of two", () => {
  expect(returnTo("", HERE)).toBeNull();
  expect(returnTo("?return_to=/map&return_to=//elsewhere.example", HERE)).toBe("/map");
  expect(returnTo("?return_to=//elsewhere.example&return_to=/map", HERE)).toBeNull();
});

it("finds a login link in the fragment alone", () => {
  expect(linkOf("#link=abc_-1")).toBe("abc_-1");
  expect(["", "#", "#content", "#link=", "#key=abc"].map(linkOf)).toEqual([null, null, null, null, null]);
});

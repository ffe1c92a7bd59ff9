import { expect, test } from "vitest";
import { type Section, sectionsWith } from "./contents";

const sections: Section[] = [
  {
    title: "How-to guides",
    pages: [
      {
        name: "how-to/record",
        title: "Record",
        summary: "Devices.",
        headings: [{ id: "phones", text: "Phones" }],
      },
    ],
  },
  {
    title: "Reference",
    pages: [{ name: "reference/http", title: "HTTP", summary: "Routes.", headings: [] }],
  },
];

test("pages are found by title, summary and headings, and empty sections go", () => {
  const names = (words: string[]) =>
    sectionsWith(sections, words).map((section) => section.pages.map((page) => page.name));
  expect(names([])).toEqual([["how-to/record"], ["reference/http"]]);
  expect(names(["phones", "devices"])).toEqual([["how-to/record"]]);
  expect(names(["http"])).toEqual([["reference/http"]]);
  expect(names(["phones", "routes"])).toEqual([]);
});

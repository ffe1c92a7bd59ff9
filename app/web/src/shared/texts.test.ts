import { expect, test, vi } from "vitest";
import de from "../texts/de.json";
import en from "../texts/en.json";

vi.stubGlobal("location", new URL("http://127.0.0.1/map?lang=de"));
vi.stubGlobal("navigator", { languages: ["en-GB"] });
vi.stubGlobal("document", { documentElement: { lang: "en" } });
const { hasText, loadTexts, ownForm, t } = await import("./texts");

type Text = string | { other: string };

function leaves(texts: object, before = ""): [string, Text][] {
  return Object.entries(texts).flatMap(([name, one]): [string, Text][] =>
    typeof one === "string" || "other" in one ? [[before + name, one]] : leaves(one, `${before}${name}.`),
  );
}

function names(text: Text): string[] {
  const forms = typeof text === "string" ? [text] : Object.values(text);
  return [...new Set(forms.flatMap((form) => form.match(/\{\w+\}/g) ?? []))].sort();
}

const english = new Map(leaves(en));
const german = new Map(leaves(de));

test("both languages have the same texts, with the same names and forms in them", () => {
  expect([...german.keys()].sort()).toEqual([...english.keys()].sort());
  for (const [key, text] of english) {
    const other = german.get(key) as Text;
    expect(names(other), key).toEqual(names(text));
    expect(typeof other, key).toBe(typeof text);
  }
});

test("texts of many have the forms that their language knows", () => {
  for (const [language, texts] of [
    ["en", english],
    ["de", german],
  ] as const) {
    const known = [...new Intl.PluralRules(language).resolvedOptions().pluralCategories].sort();
    for (const [key, text] of texts) {
      if (typeof text !== "string") expect(Object.keys(text).sort(), key).toEqual(known);
    }
  }
});

test("a text is chosen by number, and numbers are written as the language writes them", async () => {
  expect(t("docs.found", { n: 1, guides: "" })).toMatch(/^1 operation /);
  expect(t("docs.found", { n: 1200, guides: "" })).toMatch(/^1,200 operations /);
  await loadTexts();
  expect(t("docs.found", { n: 1200, guides: "" })).toMatch(/^1\.200 Abfragen /);
  expect(t("problem.unexpected")).toContain("{what}");
  expect([hasText("page.map"), hasText("page"), hasText("page.nothing")]).toEqual([true, false, false]);
});

test("days are written as in the visitor's country where that speaks the page's language", () => {
  expect(ownForm(["fr-FR", "de-AT", "en-GB", "en-US"], "en")).toBe("en-GB");
  expect(ownForm(["fr-FR", "DE-ch"], "de")).toBe("DE-ch");
  expect(ownForm(["fr-FR"], "de")).toBe("de");
});

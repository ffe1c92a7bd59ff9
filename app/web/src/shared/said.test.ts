import { beforeAll, expect, test, vi } from "vitest";

vi.stubGlobal("location", new URL("http://127.0.0.1/drives/1?lang=de"));
vi.stubGlobal("navigator", { languages: ["en-GB"] });
vi.stubGlobal("document", { documentElement: { lang: "en" } });
const { inWords, loadSaid } = await import("./said");
const { loadTexts } = await import("./texts");

beforeAll(async () => {
  await loadTexts();
  await loadSaid();
});

test("a sentence of the service is said in the page's language, with figures as it writes them", () => {
  const said = { key: "drive.few_on_roads", parameters: { share: 0.456 } };
  expect(inWords("Only 46% ...", said)).toMatch(/^Nur 46 % der Positionen liegen auf bekannten Straßen\./);
  const off = { key: "csv.coarse_barometer", parameters: { step_hpa: 1.25, step_m: 10 } };
  expect(inWords("", off)).toContain("Stufen von 1,3 hPa, das sind 10 m Höhe");
});

test("sentences inside of sentences, lists and fixed words are said so, too", () => {
  const place = { key: "place.line", parameters: { n: 7 } };
  const first = { key: "fault.at", parameters: { place, fault: { key: "fault.no_time", parameters: {} } } };
  const said = { key: "log.skipped", parameters: { n: 1200, reason: "without a time", first } };
  expect(inWords("", said)).toBe("1.200 × ausgelassen: ohne Zeit; zuerst: Zeile 7: sie hat keine Zeit.");
  const both = {
    key: "joined",
    parameters: { by: " ", parts: [{ key: "drive.no_ground", parameters: {} }, "Mine."] },
  };
  expect(inWords("", both)).toMatch(/nicht verwendet werden\. Mine\.$/);
  const cells = { key: "drive.unsolved", parameters: { cells: ["8/12", "8/13"], more: "" } };
  expect(inWords("", cells)).toContain("(8/12, 8/13)");
});

test("a page names no option of the command line", () => {
  const said = { key: "csv.unknown_near", parameters: { name: "Lattitude", match: "lat_deg" } };
  expect(inWords("", said)).toBe(
    "Lattitude ist nicht bekannt; meinten Sie lat_deg? Dann sagen Sie es unter Spalten der Datei auf der Seite der Fahrt.",
  );
});

test("what has no key, or one of another version, stays as the service wrote it", () => {
  expect(inWords("Look.", null)).toBe("Look.");
  expect(inWords("Look.", { key: "drive.of_a_later", parameters: {} })).toBe("Look.");
  const inner = { key: "drive.of_a_later", parameters: {} };
  expect(inWords("Look.", { key: "bundle.of", parameters: { name: "a", sentence: inner } })).toBe("Look.");
  expect(inWords("Look.", { key: "drive.few_on_roads", parameters: {} })).toBe("Look.");
});

test("a region that is called as a word of ours keeps its name", () => {
  const none = { key: "roads.has", parameters: { region: "roads", n: 2, there: "", gone: "" } };
  expect(inWords("", none)).toMatch(/^Region roads hat 2 Abschnitte/);
});

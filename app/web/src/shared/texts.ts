/**
 * The pages' texts, one file per language under `texts/`: `t("map.title")`, `t("map.shown", { n: 3, all: 10 })`.
 *
 * A text is a string with `{names}`, or an object of plural forms (`one`, `other` ... as Intl.PluralRules names them),
 * of which `n` chooses. English is the fallback, and the keys of its file are the ones that there are.
 */
import en from "../texts/en.json";

type Leaves<T> = T extends string | { other: string }
  ? ""
  : { [K in keyof T & string]: `${K}${Leaves<T[K]> extends "" ? "" : `.${Leaves<T[K]>}`}` }[keyof T & string];
export type TextKey = Leaves<typeof en>;
export type TextValues = Record<string, string | number>;

const LANGUAGES = { en: "English", de: "Deutsch" } as const;
export type Language = keyof typeof LANGUAGES;
const CHOICE = "versant.language";

let language: Language = "en";
let texts: unknown = en;

/** The languages and what each calls itself. */
export const languages = Object.entries(LANGUAGES) as [Language, string][];

function wanted(): Language {
  const asked = new URLSearchParams(location.search).get("lang");
  let chosen: string | null = null;
  try {
    chosen = localStorage.getItem(CHOICE);
  } catch {
    // storage may be forbidden
  }
  const wishes = [asked, chosen, ...navigator.languages].map((one) => one?.slice(0, 2).toLowerCase() ?? "");
  return (wishes.find((one) => one in LANGUAGES) as Language | undefined) ?? "en";
}

/** Load the visitor's language; call it before anything is shown. */
export async function loadTexts(): Promise<void> {
  language = wanted();
  if (language === "de") texts = (await import("../texts/de.json")).default;
  document.documentElement.lang = language;
}

/** The language of the page. */
export function currentLanguage(): Language {
  return language;
}

/** Whose days and times are written: the visitor's country, where its language is the page's. */
export function ownForm(languages: readonly string[], of: Language = language): string {
  return languages.find((one) => one.slice(0, 2).toLowerCase() === of) ?? of;
}

/** Keep the visitor's choice and show the page anew. */
export function chooseLanguage(chosen: Language): void {
  localStorage.setItem(CHOICE, chosen);
  const here = new URL(location.href);
  here.searchParams.delete("lang");
  if (here.href === location.href) location.reload();
  else location.href = here.href;
}

function found(key: string, from: unknown): unknown {
  return key
    .split(".")
    .reduce<unknown>((at, part) => (at as Record<string, unknown> | undefined)?.[part], from);
}

/** Whether there is such a text: for keys that are made of what the service answers. */
export function hasText(key: string): key is TextKey {
  const text = found(key, en);
  return typeof text === "string" || (typeof text === "object" && text !== null && "other" in text);
}

/** The text in the visitor's language; numbers among the values are written as the language writes them. */
export function t(key: TextKey, values: TextValues = {}): string {
  let text = found(key, texts) ?? found(key, en);
  if (typeof text === "object" && text !== null) {
    const forms = text as Record<string, string>;
    const form = new Intl.PluralRules(language).select(Number(values["n"] ?? 0));
    text = forms[form] ?? forms["other"];
  }
  if (typeof text !== "string") return key;
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => {
    const value = values[name];
    if (value === undefined) return whole;
    return typeof value === "number" ? value.toLocaleString(language) : value;
  });
}

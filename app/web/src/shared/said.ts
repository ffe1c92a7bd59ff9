/**
 * Sentences of the service in the page's language, by their keys: its own catalogues of messages, built into a chunk
 * that pages load where they show one. What has no key, or one of another version, is shown as the service wrote it.
 */
import { currentLanguage, hasText, type TextKey, t } from "./texts";

export interface Said {
  key: string;
  parameters: Record<string, unknown>;
}
type Template = string | { one: string; other: string };

let templates: Record<string, Template> = {};
let terms: Record<string, string> = {};
let loaded: Promise<void> | undefined;

/** Load the words; call it before anything is said. */
export function loadSaid(): Promise<void> {
  loaded ??= (
    currentLanguage() === "de"
      ? Promise.all([
          import("../../../../fusion/catalogues/de.json"),
          import("../../../core/messages/de.json"),
        ])
      : Promise.all([
          import("../../../../fusion/catalogues/en.json"),
          import("../../../core/messages/en.json"),
        ])
  ).then((all) => {
    for (const { default: one } of all) {
      const { terms: more, ...rest } = one as Record<string, unknown>;
      templates = { ...templates, ...(rest as Record<string, Template>) };
      terms = { ...terms, ...(more as Record<string, string> | undefined) };
    }
  });
  return loaded;
}

/** A sentence of the service, whose English is `text`. */
export function inWords(text: string, said: Said | null | undefined): string {
  if (!said || (currentLanguage() === "en" && !hasOwn(said))) return text;
  return written(said) ?? text;
}

/** Whether the pages have words of their own for it, or for a sentence in it. */
function hasOwn(value: unknown): boolean {
  if (Array.isArray(value)) return value.some(hasOwn);
  if (!isSaid(value)) return false;
  return hasText(`said.${value.key}`) || Object.values(value.parameters).some(hasOwn);
}

/** A fixed English word or phrase of the service, or its name of a kind of failure. */
export function term(text: string): string {
  const kind = `drives.failure.${text}`;
  return terms[text] ?? (hasText(kind) ? t(kind as TextKey) : text);
}

function isSaid(value: unknown): value is Said {
  return typeof value === "object" && value !== null && "key" in value && "parameters" in value;
}

/** The words; undefined where a key in it has none. */
function written(said: Said): string | undefined {
  if (said.key === "joined")
    return list(said.parameters["parts"] as unknown[], term(said.parameters["by"] as string));
  // A page has other words than a command line where it has other ways.
  const own = `said.${said.key}`;
  const template: Template | undefined = hasText(own) ? t(own as TextKey) : templates[said.key];
  if (template === undefined) return undefined;
  const form =
    typeof template === "string" ? template : said.parameters["n"] === 1 ? template.one : template.other;
  let whole = true;
  const hole = /\{\{|\}\}|\{(\w+)(![a-z])?(?::([^}]*))?\}/g;
  const words = form.replace(hole, (all, name?: string, quoted?: string, spec?: string) => {
    if (name === undefined) return all[0] as string;
    const given = said.parameters[name];
    // What is somebody's own, in quotes or not, is no word of ours.
    const own = quoted && typeof given === "string";
    const value = !own ? shown(given, spec) : quoted === "!r" ? `'${given}'` : given;
    whole &&= value !== undefined;
    return value ?? "";
  });
  return whole ? words : undefined;
}

function list(parts: unknown[], between: string): string | undefined {
  const all = parts.map((one) => shown(one));
  return all.includes(undefined) ? undefined : all.join(between);
}

function shown(value: unknown, spec = ""): string | undefined {
  if (Array.isArray(value)) return list(value, ", ");
  if (isSaid(value)) return written(value);
  if (typeof value === "number") return figure(value, spec);
  if (value === null) return "–";
  return typeof value === "string" ? term(value) : undefined;
}

/** A number as Python's format `spec` writes it (`.1f`, `+.1f`, `.0%`, `.3g`), as the language does. */
function figure(value: number, spec: string): string {
  const [, plus, digits, kind] = /^(\+?)(?:\.(\d+))?([fg%]?)$/.exec(spec) ?? [];
  const places = Number(digits ?? 6);
  const sign: Intl.NumberFormatOptions = plus ? { signDisplay: "always" } : {};
  const language = currentLanguage();
  if (kind === "f" || kind === "%") {
    const fixed = { minimumFractionDigits: places, maximumFractionDigits: places, ...sign };
    const text = (kind === "%" ? 100 * value : value).toLocaleString(language, fixed);
    return kind === "%" ? `${text} %` : text;
  }
  const short =
    kind === "g" ? { maximumSignificantDigits: Math.max(places, 1) } : { maximumFractionDigits: 9 };
  return value.toLocaleString(language, { ...short, ...sign });
}

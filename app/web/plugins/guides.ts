/**
 * The guides of `.docs/*.md` as modules: `virtual:guides` lists them, and each is a chunk of its own that is loaded when
 * somebody opens it. Pictures and files that a guide leads to are shipped with it. A link that leads nowhere ends the build.
 */
import { existsSync, readdirSync, readFileSync } from "node:fs";
import { basename, resolve } from "node:path";
import MarkdownIt, { type Token } from "markdown-it";
import type { Plugin } from "vite";

export interface Heading {
  id: string;
  text: string;
}

export interface Rendered {
  title: string;
  /** The first sentence, as text. */
  summary: string;
  /** Headings below the title, of the second level. */
  headings: Heading[];
  /** HTML in which `{{n}}` stands for the address of the nth file. */
  html: string;
  /** Files of the folder that the guide shows or leads to. */
  files: string[];
}

const LIST = "virtual:guides";
const ONE = "virtual:guide/";
const FORBIDDEN = /<script|<style|<iframe|\sstyle=|\son\w+=/i;

/** The name of a heading in addresses, as repositories' readers make it: links of the guides count on it. */
export function slug(text: string): string {
  return text
    .toLowerCase()
    .replace(/[^\p{L}\p{N}\s_-]/gu, "")
    .trim()
    .replace(/\s/g, "-");
}

function plain(token: Token | undefined): string {
  return (token?.children ?? [])
    .map((one: Token) => (one.type === "softbreak" ? " " : one.type === "image" ? "" : one.content))
    .join("");
}

function sentence(tokens: Token[]): string {
  const at = tokens.findIndex((one) => one.type === "paragraph_open");
  const text = at < 0 ? "" : plain(tokens[at + 1]);
  return /^.*?[.:](?=\s|$)/su.exec(text)?.[0].replace(/:$/, ".") ?? text;
}

/** Where a link or a picture of a guide leads; null: out of what is shipped. */
function target(address: string, folder: string, files: string[]): string | null {
  if (/^(https?:|#)/.test(address)) return address;
  const [path = "", anchor] = address.split("#");
  if (path.startsWith("..")) return null;
  if (!existsSync(resolve(folder, path))) throw new Error(`a guide leads to ${address}, which is not there`);
  if (path.endsWith(".md")) return `/docs/${basename(path, ".md")}${anchor ? `#${anchor}` : ""}`;
  if (!files.includes(path)) files.push(path);
  return `{{${files.indexOf(path)}}}`;
}

function numbered(tokens: Token[]): Heading[] {
  const seen = new Map<string, number>();
  const found: Heading[] = [];
  tokens.forEach((token, at) => {
    if (token.type !== "heading_open") return;
    const text = plain(tokens[at + 1]);
    const base = slug(text);
    const times = seen.get(base) ?? 0;
    seen.set(base, times + 1);
    const id = times === 0 ? base : `${base}-${times}`;
    token.attrSet("id", id);
    if (token.tag === "h2") found.push({ id, text });
  });
  return found;
}

function led(tokens: Token[], folder: string, files: string[]): void {
  const left: Token[] = [];
  for (const token of tokens) {
    const attribute = token.type === "image" ? "src" : "href";
    const address = token.attrGet(attribute) as string | null;
    if (token.type === "link_close") {
      const opened = left.pop();
      if (opened?.tag === "span") token.tag = "span";
    }
    if (token.type === "link_open") left.push(token);
    if (address === null) continue;
    const leads = target(address, folder, files);
    if (leads === null) {
      token.tag = "span";
      token.attrs = null;
    } else {
      token.attrSet(attribute, leads);
      if (leads.startsWith("http")) token.attrSet("rel", "noreferrer");
    }
  }
}

function reader() {
  const made = new MarkdownIt({ html: true, linkify: false });
  const rules = made.renderer.rules;
  // A heading is the link to itself; the title leads nowhere.
  rules["heading_open"] = (tokens, at) => {
    const token = tokens[at] as Token;
    const id = token.attrGet("id") ?? "";
    return token.tag === "h1" ? `<h1 id="${id}">` : `<${token.tag} id="${id}"><a class="self" href="#${id}">`;
  };
  rules["heading_close"] = (tokens, at) => {
    const tag = tokens[at]?.tag;
    return tag === "h1" ? "</h1>\n" : `</a></${tag}>\n`;
  };
  // What scrolls sideways can be reached by keyboard.
  rules["table_open"] = () => '<div class="wide" tabindex="0"><table>\n';
  rules["table_close"] = () => "</table></div>\n";
  for (const cell of ["th_open", "td_open"]) {
    rules[cell] = (tokens, at) => {
      const token = tokens[at] as Token;
      const right = /right/.test(String(token.attrGet("style") ?? "")) ? ' class="number"' : "";
      return `<${token.tag}${right}>`;
    };
  }
  const fence = (tokens: Token[], at: number) =>
    `<pre tabindex="0"><code>${made.utils.escapeHtml(tokens[at]?.content ?? "")}</code></pre>\n`;
  rules["fence"] = fence;
  rules["code_block"] = fence;
  return made;
}

/** One guide, ready to be shown. */
export function rendered(text: string, folder: string): Rendered {
  const made = reader();
  const tokens = made.parse(text.replace(/<!--.*?-->\n?/gs, ""), {});
  const files: string[] = [];
  const headings = numbered(tokens);
  for (const token of tokens) if (token.children) led(token.children, folder, files);
  const html = made.renderer.render(tokens, made.options, {});
  if (FORBIDDEN.test(html)) throw new Error("a guide holds markup that the pages' policy refuses");
  const title = plain(tokens[tokens.findIndex((one) => one.tag === "h1") + 1]);
  return { title, summary: sentence(tokens), headings, html, files };
}

function namesIn(folder: string): string[] {
  return readdirSync(folder)
    .filter((name) => name.endsWith(".md"))
    .map((name) => basename(name, ".md"))
    .sort();
}

function listing(folder: string): string {
  const entries = namesIn(folder).map((name) => {
    const { title, summary, headings } = rendered(
      readFileSync(resolve(folder, `${name}.md`), "utf8"),
      folder,
    );
    const told = JSON.stringify({ name, title, summary, headings });
    return `{ ...${told}, load: () => import("${ONE}${name}") }`;
  });
  return `export const guides = [${entries.join(",\n")}];`;
}

function chunk(name: string, folder: string): string {
  const { html, files } = rendered(readFileSync(resolve(folder, `${name}.md`), "utf8"), folder);
  const imports = files.map(
    (file, n) => `import file${n} from ${JSON.stringify(`${resolve(folder, file)}?url`)};`,
  );
  const text = JSON.stringify(html).replace(/\{\{(\d+)\}\}/g, '" + file$1 + "');
  return `${imports.join("\n")}\nexport default ${text};`;
}

/** Names of the guides, and of what they lead to. */
export function bundled(folder: string): string[] {
  const names = namesIn(folder).map((name) => `${name}.md`);
  const files = names.flatMap((name) => rendered(readFileSync(resolve(folder, name), "utf8"), folder).files);
  return [...names, ...new Set(files)];
}

/** The plugin; `folder` is where the guides are. */
export function guides(folder: string): Plugin {
  return {
    name: "guides",
    resolveId: (id) => (id === LIST || id.startsWith(ONE) ? `\0${id}` : null),
    load(id) {
      if (id === `\0${LIST}`) return listing(folder);
      if (!id.startsWith(`\0${ONE}`)) return null;
      const name = id.slice(ONE.length + 1);
      this.addWatchFile(resolve(folder, `${name}.md`));
      return chunk(name, folder);
    },
  };
}

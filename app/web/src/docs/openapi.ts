/** The API's description, read: groups of operations, what a schema asks for in words, examples, a line for curl. */

export interface Schema {
  $ref?: string;
  type?: string | string[];
  format?: string;
  title?: string;
  description?: string;
  properties?: Record<string, Schema>;
  required?: string[];
  items?: Schema;
  prefixItems?: Schema[];
  additionalProperties?: boolean | Schema;
  anyOf?: Schema[];
  oneOf?: Schema[];
  allOf?: Schema[];
  enum?: unknown[];
  const?: unknown;
  default?: unknown;
  example?: unknown;
  examples?: unknown[];
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
  minLength?: number;
  maxLength?: number;
  minItems?: number;
  maxItems?: number;
  pattern?: string;
}

export interface Parameter {
  name: string;
  in: "query" | "path" | "header" | "cookie";
  required?: boolean;
  description?: string;
  schema?: Schema;
  example?: unknown;
  style?: string;
  explode?: boolean;
}

export interface Media {
  schema?: Schema;
  example?: unknown;
}

export interface Answer {
  description: string;
  content?: Record<string, Media>;
  headers?: Record<string, { description?: string }>;
}

interface Described {
  summary?: string;
  description?: string;
  tags?: string[];
  parameters?: Parameter[];
  requestBody?: { required?: boolean; description?: string; content: Record<string, Media> };
  responses: Record<string, Answer>;
}

export interface Operation extends Described {
  /** Its name in addresses. */
  id: string;
  method: string;
  path: string;
}

export interface ApiDocument {
  openapi: string;
  info: { title: string; version: string; description?: string };
  paths: Record<string, Record<string, Described>>;
  components?: { schemas?: Record<string, Schema> };
  tags?: { name: string; description?: string }[];
}

export interface Group {
  tag: string;
  description: string;
  operations: Operation[];
}

/** The operations by what they are for, in the document's order. */
export function groupsOf(document: ApiDocument): Group[] {
  const groups = new Map<string, Group>();
  for (const { name, description = "" } of document.tags ?? []) {
    groups.set(name, { tag: name, description, operations: [] });
  }
  for (const [path, item] of Object.entries(document.paths)) {
    for (const [method, described] of Object.entries(item)) {
      const operation = { ...described, id: idOf(method, path), method: method.toUpperCase(), path };
      for (const tag of described.tags ?? ["other"]) {
        const group = groups.get(tag) ?? { tag, description: "", operations: [] };
        group.operations.push(operation);
        groups.set(tag, group);
      }
    }
  }
  return [...groups.values()].filter((group) => group.operations.length > 0);
}

function idOf(method: string, path: string): string {
  const words = path.split(/[^A-Za-z0-9_.]+/).filter(Boolean);
  return [method, ...(words.length ? words : ["root"])].join("-");
}

/** Those operations in which every word is found. */
export function matching(groups: Group[], words: string[]): Group[] {
  if (words.length === 0) return groups;
  return groups
    .map((group) => ({ ...group, operations: group.operations.filter((one) => holds(group, one, words)) }))
    .filter((group) => group.operations.length > 0);
}

function holds(group: Group, one: Operation, words: string[]): boolean {
  const parameters = (one.parameters ?? []).map((each) => `${each.name} ${each.description ?? ""}`);
  const text = [group.tag, one.method, one.path, one.summary, one.description, ...parameters].join(" ");
  const lower = text.toLowerCase();
  return words.every((word) => lower.includes(word));
}

/** What a schema stands for: references followed, `null` among alternatives told apart. */
export interface Meaning {
  schema: Schema;
  /** The name of what it refers to. */
  name: string | null;
  nullable: boolean;
  /** More than one thing that it may be. */
  alternatives: Schema[];
}

export function meaningOf(schema: Schema, document: ApiDocument): Meaning {
  let at = schema;
  let name: string | null = null;
  let nullable = false;
  for (let step = 0; step < 20; step += 1) {
    if (at.$ref) {
      name = at.$ref.split("/").at(-1) ?? null;
      at = { ...document.components?.schemas?.[name ?? ""], ...without(at, "$ref") };
      continue;
    }
    const choices = at.anyOf ?? at.oneOf ?? (at.allOf?.length === 1 ? at.allOf : undefined);
    if (!choices) break;
    const real = choices.filter((one) => one.type !== "null");
    nullable = nullable || real.length < choices.length;
    if (real.length !== 1) return { schema: at, name, nullable, alternatives: real };
    at = { ...real[0], ...without(at, "anyOf", "oneOf", "allOf") };
  }
  return { schema: at, name, nullable, alternatives: [] };
}

function without(schema: Schema, ...names: (keyof Schema)[]): Schema {
  return Object.fromEntries(Object.entries(schema).filter(([key]) => !names.includes(key as keyof Schema)));
}

/** The type in a word or two, as JSON Schema names types. */
export function typeOf(schema: Schema, document: ApiDocument): string {
  const { schema: at, name, nullable, alternatives } = meaningOf(schema, document);
  const word = alternatives.length
    ? alternatives.map((one) => typeOf(one, document)).join(" | ")
    : at.items
      ? `${typeOf(at.items, document)}[]`
      : (name ?? [at.type ?? (at.const === undefined ? "any" : "string")].flat().join(" | "));
  return `${word}${at.format ? ` (${at.format})` : ""}${nullable ? " | null" : ""}`;
}

/** What a value must keep to, in signs: `≥ 1`, `≤ 100`. Where all numbers end is no bound worth telling. */
export function boundsOf(schema: Schema): string[] {
  const signs: [keyof Schema, string][] = [
    ["minimum", "≥ "],
    ["exclusiveMinimum", "> "],
    ["maximum", "≤ "],
    ["exclusiveMaximum", "< "],
  ];
  const found = signs
    .filter(([key]) => Math.abs(Number(schema[key])) <= Number.MAX_SAFE_INTEGER)
    .map(([key, sign]) => `${sign}${schema[key]}`);
  return schema.pattern ? [...found, schema.pattern] : found;
}

/** An example of a value; undefined: none is known. */
export function exampleOf(schema: Schema | undefined, document: ApiDocument, depth = 0): unknown {
  if (!schema || depth > 6) return undefined;
  const given = schema.example ?? schema.examples?.[0] ?? schema.const ?? schema.default;
  if (given !== undefined) return given;
  const { schema: at, alternatives } = meaningOf(schema, document);
  if (alternatives[0]) return exampleOf(alternatives[0], document, depth + 1);
  const known = at.example ?? at.examples?.[0] ?? at.default ?? at.enum?.[0];
  if (known !== undefined) return known;
  if (at.properties) {
    const parts = Object.entries(at.properties).map(([key, one]) => [
      key,
      exampleOf(one, document, depth + 1),
    ]);
    return Object.fromEntries(parts.filter(([, value]) => value !== undefined));
  }
  if (at.items) {
    const one = exampleOf(at.items, document, depth + 1);
    return one === undefined ? [] : [one];
  }
  return undefined;
}

/** What a parameter is tried with, as one writes it. */
export function sampleOf(parameter: Parameter, document: ApiDocument): string {
  const { schema } = meaningOf(parameter.schema ?? {}, document);
  const value = parameter.example ?? schema.example ?? schema.examples?.[0] ?? schema.default;
  if (value === undefined || value === null) return "";
  return Array.isArray(value) ? value.join(",") : String(value);
}

/** The address that these values ask for; empty ones are left out. */
export function addressOf(operation: Operation, values: Record<string, string>): string {
  let path = operation.path;
  const query = new URLSearchParams();
  for (const parameter of operation.parameters ?? []) {
    const value = values[parameter.name] ?? "";
    if (parameter.in === "path") path = path.replace(`{${parameter.name}}`, encodeURIComponent(value));
    else if (parameter.in === "query" && value !== "") {
      const repeated = parameter.schema?.type === "array" && parameter.explode !== false;
      for (const one of repeated ? value.split(",") : [value]) query.append(parameter.name, one);
    }
  }
  const asked = query.toString();
  return asked ? `${path}?${asked}` : path;
}

function quoted(text: string): string {
  return `'${text.replaceAll("'", "'\\''")}'`;
}

/** The operation as a line for a shell. */
export function curlOf(operation: Operation, origin: string, document: ApiDocument): string {
  const values: Record<string, string> = {};
  for (const one of operation.parameters ?? []) {
    if (one.in === "path") values[one.name] = sampleOf(one, document) || one.name.toUpperCase();
  }
  const parts = ["curl"];
  if (operation.method !== "GET") parts.push("-X", operation.method);
  const content = operation.requestBody?.content ?? {};
  if (content["multipart/form-data"]) parts.push("-F", "file=@FILE");
  else if (content["application/json"]) {
    const media = content["application/json"];
    const body = media.example ?? exampleOf(media.schema, document) ?? {};
    parts.push("-H", quoted("Content-Type: application/json"), "-d", quoted(JSON.stringify(body)));
  }
  return [...parts, quoted(origin + addressOf(operation, values))].join(" ");
}

/** What can be chosen for a drive, asked for once, and what has been chosen as a query of an upload or `reprocess`. */
import type { components } from "../api/schema";
import { api, got } from "./api";
import { allowed, type Chosen, type Schema } from "./SchemaFields";
import { loadSaid, term } from "./said";

export type Methods = components["schemas"]["MethodList"];
export interface MethodChosen {
  /** Empty: the service's default. */
  method: string;
  options: Chosen;
  gnss: string;
  gnssOptions: Chosen;
}

/** What a choice is and its options are, in the language of the page; its title is the first clause of that. */
function said<T extends Methods["positionings"][number]>(choice: T): T {
  const description = term(choice.description);
  const options = structuredClone(choice.options) as Schema;
  for (const one of Object.values(options.properties ?? {})) one.description = term(one.description ?? "");
  const title = description.split(/\. |: |; /)[0]?.replace(/\.$/, "") ?? choice.title;
  return { ...choice, title, description, source: term(choice.source), options };
}

function inLanguage(all: Methods): Methods {
  const methods = all.methods.map((one) => ({ ...said(one), needs: one.needs.map(term) }));
  return { ...all, methods, positionings: all.positionings.map(said) };
}

export const USUAL: MethodChosen = { method: "", options: {}, gnss: "", gnssOptions: {} };

let asked: Promise<Methods> | null = null;

/** The methods; asked for again only where that failed. */
export function methods(): Promise<Methods> {
  asked ??= Promise.all([got(api.GET("/v1/methods")), loadSaid()])
    .then(([all]) => inLanguage(all))
    .catch((error) => {
      asked = null;
      throw error;
    });
  return asked;
}

/** The query that says what was chosen; nothing where all is as usual. */
export function chosenQuery(chosen: MethodChosen, known: Methods | null): URLSearchParams {
  const query = new URLSearchParams();
  // Options belong to a method: whoever sets one of the default's means that method by name.
  const method = chosen.method || (Object.keys(chosen.options).length > 0 ? (known?.default ?? "") : "");
  if (method) query.set("method", method);
  for (const [name, value] of Object.entries(chosen.options)) query.append("option", `${name}:${value}`);
  const gnss =
    chosen.gnss || (Object.keys(chosen.gnssOptions).length > 0 ? (known?.default_positioning ?? "") : "");
  if (gnss) query.set("gnss", gnss);
  for (const [name, value] of Object.entries(chosen.gnssOptions))
    query.append("gnss_option", `${name}:${value}`);
  return query;
}

/** Whether every value is within its range. */
export function usable(chosen: MethodChosen, known: Methods | null): boolean {
  if (known === null) return true;
  const method = known.methods.find((one) => one.name === (chosen.method || known.default));
  const gnss = known.positionings.find((one) => one.name === (chosen.gnss || known.default_positioning));
  const fits = (schema: Schema | undefined, values: Chosen) =>
    Object.entries(values).every(([name, value]) => allowed(schema?.properties?.[name] ?? {}, value));
  return (
    fits(method?.options as Schema | undefined, chosen.options) &&
    fits(gnss?.options as Schema | undefined, chosen.gnssOptions)
  );
}

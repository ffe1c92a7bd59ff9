/** What columns of a file are taken as, and how what people correct is said to the service. */
import type { components } from "../api/schema";
import { hasText, t } from "../shared/texts";

export type LogColumn = components["schemas"]["LogColumn"];
/** By the name of a file's column: what it is to be taken as; empty: it is not used. */
export type Choice = Record<string, string>;
/** Versant's name -> the file's. */
export type Named = Record<string, string>;

/** Said of a column of Versant that the file has not, whatever its names are like. */
const NOT_USED = "-";

/** What a column is taken as, corrected or not. */
export function takenAs(column: LogColumn, choice: Choice): string {
  return choice[column.name] ?? column.taken_as ?? "";
}

/** A column of Versant in plain words. */
export function inWords(name: string): string {
  const key = `columns.as.${name}`;
  return hasText(key) ? t(key) : name;
}

/** What more than one column would be taken as, of that which was corrected. */
export function twice(columns: LogColumn[], choice: Choice): string[] {
  const all = columns.map((one) => takenAs(one, choice));
  const changed = columns.filter((one) => takenAs(one, choice) !== (one.taken_as ?? ""));
  const doubled = changed
    .map((one) => takenAs(one, choice))
    .filter((as) => as !== "" && all.indexOf(as) !== all.lastIndexOf(as));
  return [...new Set(doubled)];
}

/**
 * What is to be said of the columns so that they are taken as chosen. Guesses that stay are not said, for a name that
 * is said loses what was guessed beside it. `ours`: what can be said; `had`: what was said before.
 */
export function corrected(columns: LogColumn[], choice: Choice, ours: string[], had: Named): Named {
  const used = new Set(columns.map((one) => takenAs(one, choice)));
  const said: Named = {};
  for (const one of columns) {
    const [before, as] = [one.taken_as ?? "", takenAs(one, choice)];
    const wasSaid = !one.guessed && had[as] === one.name;
    if (ours.includes(as) && (as !== before || wasSaid)) said[as] = one.name;
    if (ours.includes(before) && !used.has(before)) said[before] = NOT_USED;
  }
  for (const [name, theirs] of Object.entries(had))
    if (theirs === NOT_USED && !used.has(name)) said[name] = NOT_USED;
  return said;
}

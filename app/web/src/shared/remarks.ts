/** What the service remarks on a drive, and why one failed, as pages say it. */
import { inWords, type Said } from "./said";
import { hasText, t } from "./texts";

export interface Remark {
  text: string;
  /** Which of the service's messages it is, where that is known. */
  key: string | null;
  /** Whether it says what a person can do about it. */
  asks: boolean;
}

interface Failure {
  kind: string;
  reason: string;
  where?: string | null;
  said?: Said | null;
  where_said?: Said | null;
}

/** Whether it failed because the file holds no drive, which computing it again does not change. */
export function isNoLog(drive: { failure: { kind: string } | null }): boolean {
  return drive.failure?.kind === "unknown-format" || drive.failure?.kind === "empty-log";
}

/** The keys of remarks that say what to do; `advice.` are sentences inside of others. */
const ASKING = new Set(
  `csv.speed_unit_unknown csv.unknown_near drive.contradicts drive.feet drive.few_on_roads drive.model_there
  drive.mount_moved drive.mount_unsure drive.no_grade drive.no_slope drive.same_altitudes drive.unsolved
  drive.vertical_velocities gnss.other_day log.many_drives phone.lies_unknown phone.moved receiver.cut
  zip.unusual`.split(/\s+/),
);

function asks(value: unknown): boolean {
  if (Array.isArray(value)) return value.some(asks);
  if (typeof value !== "object" || value === null) return false;
  const { key, parameters } = value as Said;
  return ASKING.has(key) || key.startsWith("advice.") || Object.values(parameters).some(asks);
}

/** The remarks of a report. */
export function remarksOf(report: Record<string, unknown> | null | undefined): Remark[] {
  const texts = report?.["warnings"];
  const said = (report?.["warnings_said"] ?? []) as (Said | null)[];
  if (!Array.isArray(texts)) return [];
  return texts.map((text, at) => ({
    text: inWords(String(text), said[at]),
    key: said[at]?.key ?? null,
    asks: asks(said[at]),
  }));
}

/** The kind of a failure in words. */
export function failureText(kind: string): string {
  const key = `drives.failure.${kind}`;
  return hasText(key) ? t(key) : kind;
}

/** Why something failed. */
export function reasonOf(failure: Failure): string {
  return inWords(failure.reason, failure.said);
}

/** The line, byte or field at fault. */
export function whereOf(failure: Failure): string {
  return inWords(failure.where ?? "", failure.where_said);
}

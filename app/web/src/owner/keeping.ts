/** For how long logs are kept, as it is chosen and as the service takes it: days, or null for what holds for all. */

export type Choice = "as_all" | "done" | "days";

export function choiceOf(days: number | null): Choice {
  if (days === null) return "as_all";
  return days === 0 ? "done" : "days";
}

export function daysOf(choice: Choice, typed: string): number | null {
  if (choice === "as_all") return null;
  return choice === "done" ? 0 : Number(typed);
}

/** Whether something may be deleted by it that is kept as it is now (null: for good). What holds for all is not known. */
export function isShorter(wanted: number | null, now: number | null): boolean {
  return wanted !== null && (now === null || wanted < now);
}

/** Days of the visitor's own time zone, as fields take them, and the moments that they begin at. */

/** Local midnight of a day, or of the one after it, as the service takes it. */
export function midnight(day: string, later = 0): string | null {
  const [year, month, date] = day.split("-").map(Number);
  if (year === undefined || month === undefined || date === undefined || year < 1900) return null;
  return new Date(year, month - 1, date + later).toISOString();
}

/** The local day of a moment, as a field takes it. */
export function dayOf(moment: string | null, earlierMs = 0): string {
  const at = new Date(Date.parse(moment ?? "") - earlierMs);
  if (Number.isNaN(at.getTime())) return "";
  return [at.getFullYear(), at.getMonth() + 1, at.getDate()]
    .map((part) => String(part).padStart(2, "0"))
    .join("-");
}

/** The header of a CSV, read where the file lies, so that people can say which of its columns is which. */

const ENOUGH_BYTES = 64 * 1024;
const GZIP = [0x1f, 0x8b];

async function beginning(file: File): Promise<string> {
  const head = file.slice(0, ENOUGH_BYTES);
  const bytes = new Uint8Array(await head.arrayBuffer());
  if (bytes[0] !== GZIP[0] || bytes[1] !== GZIP[1]) return new TextDecoder().decode(bytes);
  const reader = head.stream().pipeThrough(new DecompressionStream("gzip")).getReader();
  const first = await reader.read();
  reader.cancel().catch(() => undefined); // it was cut off, and says so
  return new TextDecoder().decode(first.value);
}

/** The names in the first line that has any. */
export function headerOf(text: string): string[] {
  const line = text.split(/\r?\n/).find((one) => one.trim() !== "" && !one.startsWith("#")) ?? "";
  const delimiters = [",", ";", "\t", "|"];
  const cells = delimiters.map((one) => line.split(one)).sort((a, b) => b.length - a.length)[0] ?? [];
  return cells.map((cell) => cell.trim().replace(/^"(.*)"$/, "$1")).filter((cell) => cell !== "");
}

/** The names of the file's columns; none where it cannot be read. */
export async function columnsOf(file: File): Promise<string[]> {
  try {
    return headerOf(await beginning(file));
  } catch {
    return [];
  }
}

/** Those of `ours` that a refusal speaks of and the file does not have. */
export function missingColumns(reason: string, ours: string[], theirs: string[]): string[] {
  const words = new Set(reason.split(/[^A-Za-z0-9_]+/));
  return ours.filter((one) => words.has(one) && !theirs.includes(one));
}

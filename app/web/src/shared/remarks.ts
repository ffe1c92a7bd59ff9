/** Sentences of the service as pages say them, and what they lead to. */

/** Whether it failed because the file holds no drive, which computing it again does not change. */
export function isNoLog(drive: { failure: { kind: string } | null }): boolean {
  return drive.failure?.kind === "unknown-format" || drive.failure?.kind === "empty-log";
}

// The service's sentences name options of its command line, which nobody has on a page.
const OPTIONS: readonly [RegExp, string][] = [
  [
    / Name it by --columns (\S+?)=([^.]+)\./g,
    " Then say so under Columns of the file on the page of the drive.",
  ],
  [/, say what is what by --columns\./g, ", correct it under Columns of the file on the page of the drive."],
  [
    /, or name the one that holds it, such as `--columns ([^=`]+)=([^`]+)`\./g,
    ", or rename the one that holds it.",
  ],
  [/, or name the one that holds it by `--columns`\./g, ", or rename the one that holds it."],
  [/ or say by --columns NAME=ITS_NAME which is which;/g, " or say which is which;"],
  [/--columns (\S+?)=/g, "$1 is "],
];

/** A sentence of the service as a page says it. */
export function onPage(text: string): string {
  return OPTIONS.reduce((said, [option, words]) => said.replace(option, words), text);
}

/** One upload, whichever way its files go. */
import type { components } from "../api/schema";
import { IN_PARTS_BYTES, inParts, TOO_MANY } from "./parts";
import { asked, Refusal } from "./request";

export type Accepted = components["schemas"]["UploadAccepted"];
export type Uploaded = components["schemas"]["UploadedDrive"];
export type LeftOut = components["schemas"]["LeftOutFile"];
export type Unclear = components["schemas"]["UnclearFiles"];

export interface Transfer {
  done: Promise<Accepted>;
  cancel: () => void;
}

/** How far a transfer is. */
export interface Told {
  sent: (bytes: number) => void;
  /** Whether it waits for the connection to come back. */
  lost: (is: boolean) => void;
}

/**
 * Send the files together, as one drive or as many as the service finds; a large one by itself in parts. The promise
 * fails with a `Refusal`.
 */
export function send(files: File[], query: URLSearchParams, told: Told): Transfer {
  const stop = new AbortController();
  const [only] = files;
  const large = files.length === 1 && only && only.size >= IN_PARTS_BYTES;
  const whole = () => atOnce(files, query, told, stop.signal);
  const done = large
    ? inParts(only, query, told, stop.signal).catch((error) => {
        if (error instanceof Refusal && error.problem.type === TOO_MANY) return whole();
        throw error;
      })
    : whole();
  return { done: done.then((text) => JSON.parse(text) as Accepted), cancel: () => stop.abort() };
}

async function atOnce(
  files: File[],
  query: URLSearchParams,
  told: Told,
  signal: AbortSignal,
): Promise<string> {
  const [only] = files;
  const address = new URL("/v1/drives", location.origin);
  for (const [name, value] of query) address.searchParams.append(name, value);
  const headers: Record<string, string> = { Accept: "application/json" };
  let body: XMLHttpRequestBodyInit;
  if (files.length === 1 && only) {
    address.searchParams.set("filename", only.name);
    headers["Content-Type"] = "application/octet-stream";
    body = only;
  } else {
    const form = new FormData();
    for (const file of files) form.append("file", file, file.name);
    body = form;
  }
  return (await asked("POST", address, { headers, body, signal, sent: told.sent })).responseText;
}

/** One upload, with the bytes that have really gone: only XMLHttpRequest tells them. */
import type { components } from "../api/schema";
import { ApiProblem, problemOf } from "../shared/api";
import { t } from "../shared/texts";

export type Accepted = components["schemas"]["UploadAccepted"];
export type Uploaded = components["schemas"]["UploadedDrive"];
export type LeftOut = components["schemas"]["LeftOutFile"];
export type Unclear = components["schemas"]["UnclearFiles"];

/** A refusal, and after how many seconds it is worth another try; null: not by itself. */
export class Refusal extends Error {
  constructor(
    readonly problem: ApiProblem,
    readonly againAfterS: number | null,
  ) {
    super(problem.message);
  }
}

export interface Transfer {
  done: Promise<Accepted>;
  cancel: () => void;
}

const BUSY = 503;
const AGAIN_S = 5;

/** Send the files at once, as one drive or as many as the service finds. The promise fails with a `Refusal`. */
export function send(files: File[], query: URLSearchParams, sent: (bytes: number) => void): Transfer {
  const request = new XMLHttpRequest();
  const [only] = files;
  const address = new URL("/v1/drives", location.origin);
  for (const [name, value] of query) address.searchParams.append(name, value);
  let body: XMLHttpRequestBodyInit;
  if (files.length === 1 && only) {
    address.searchParams.set("filename", only.name);
    body = only;
  } else {
    const form = new FormData();
    for (const file of files) form.append("file", file, file.name);
    body = form;
  }
  request.open("POST", address);
  request.setRequestHeader("Accept", "application/json");
  if (!(body instanceof FormData)) request.setRequestHeader("Content-Type", "application/octet-stream");
  request.upload.addEventListener("progress", (event) => sent(event.loaded));
  const done = new Promise<Accepted>((resolve, reject) => {
    request.addEventListener("load", () => {
      answer(request).then(resolve, reject);
    });
    const broken = () => reject(new Refusal(new ApiProblem(0, "", t("upload.broke_off")), null));
    request.addEventListener("error", broken);
    request.addEventListener("abort", broken);
  });
  request.send(body);
  return { done, cancel: () => request.abort() };
}

async function answer(request: XMLHttpRequest): Promise<Accepted> {
  if (request.status === 200 || request.status === 202) return JSON.parse(request.responseText) as Accepted;
  const response = new Response(request.responseText, {
    status: request.status,
    statusText: request.statusText,
  });
  const after = Number(request.getResponseHeader("Retry-After") ?? AGAIN_S) || AGAIN_S;
  throw new Refusal(await problemOf(response), request.status === BUSY ? after : null);
}

/** One request, with the bytes that have really gone: only XMLHttpRequest tells them. */
import { ApiProblem, problemOf } from "../shared/api";
import { t } from "../shared/texts";

/** A refusal, and after how many seconds it is worth another try; null: not by itself. */
export class Refusal extends Error {
  constructor(
    readonly problem: ApiProblem,
    readonly againAfterS: number | null,
  ) {
    super(problem.message);
  }
}

const BUSY = 503;
const AGAIN_S = 5;

export interface Asked {
  headers?: Record<string, string>;
  body?: XMLHttpRequestBodyInit | null;
  signal: AbortSignal;
  sent?: (bytes: number) => void;
}

/** What the service answers, a success; fails with a `Refusal`, whose problem has status 0 where there was no answer. */
export async function asked(method: string, address: string | URL, how: Asked): Promise<XMLHttpRequest> {
  const request = new XMLHttpRequest();
  request.open(method, address);
  for (const [name, value] of Object.entries(how.headers ?? {})) request.setRequestHeader(name, value);
  if (how.sent) request.upload.addEventListener("progress", (event) => how.sent?.(event.loaded));
  await new Promise<void>((resolve, reject) => {
    request.addEventListener("load", () => resolve());
    const broken = () => reject(new Refusal(new ApiProblem(0, "", t("upload.broke_off")), null));
    if (how.signal.aborted) return broken();
    request.addEventListener("error", broken);
    request.addEventListener("abort", broken);
    how.signal.addEventListener("abort", () => request.abort());
    request.send(how.body ?? null);
  });
  if (request.status >= 200 && request.status < 300) return request;
  const { status, statusText, responseText } = request;
  const after = Number(request.getResponseHeader("Retry-After") ?? AGAIN_S) || AGAIN_S;
  const problem = await problemOf(new Response(responseText, { status, statusText }));
  throw new Refusal(problem, status === BUSY ? after : null);
}

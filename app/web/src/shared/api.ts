/**
 * The service's API with the types of its own OpenAPI document: `const drive = await got(api.GET("/v1/drives/{drive_id}", ...))`.
 *
 * `got` gives the answer or throws an `ApiProblem`, whose `message` is a sentence for people. An answer 401 leads to
 * one place, `toLogin`.
 */
import createClient from "openapi-fetch";
import type { paths } from "../api/schema";
import { inWords, loadSaid, type Said, term } from "./said";
import { toLogin } from "./session";
import { tellTabs } from "./tabs";
import { t } from "./texts";

/** An answer that is no success, or none at all (`status` 0). */
export class ApiProblem extends Error {
  constructor(
    readonly status: number,
    readonly title: string,
    message: string,
    readonly field: string | null = null,
    readonly type: string | null = null,
  ) {
    super(message);
  }
}

/** What an answer that is no success says; `read` is its document, where somebody has read it. */
export async function problemOf(response: Response, read?: unknown): Promise<ApiProblem> {
  if (response.status === 401) toLogin();
  return saidBy(response, read);
}

/** The same, and leads nowhere: for the page that logs in. */
export async function saidBy(response: Response, read?: unknown): Promise<ApiProblem> {
  const { status, statusText } = response;
  try {
    const document = read === undefined ? await response.json() : read;
    if (typeof document !== "object" || document === null) throw new TypeError("no document");
    const fields = document as Record<string, string | undefined>;
    await loadSaid();
    const title = term(fields["title"] ?? statusText);
    return new ApiProblem(
      status,
      title,
      inWords(fields["detail"] ?? title, (document as { said?: Said }).said),
      fields["field"] ?? null,
      fields["type"] ?? null,
    );
  } catch {
    return new ApiProblem(status, statusText, t("problem.unreadable", { status }));
  }
}

export const api = createClient<paths>({ baseUrl: location.origin });
api.use({
  onResponse({ request, response }) {
    if (request.method !== "GET" && response.ok) tellTabs();
  },
});

interface Settled<T> {
  data?: T;
  /** The document of an answer that is no success, where it has been read. */
  error?: unknown;
  response: Response;
}

/** The answer's document; throws an `ApiProblem` for whatever is no success. */
export async function got<T>(answer: Promise<Settled<T>>): Promise<T> {
  let settled: Settled<T>;
  try {
    settled = await answer;
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new ApiProblem(0, t("problem.offline"), t("problem.offline"));
  }
  if (!settled.response.ok) throw await problemOf(settled.response, settled.error);
  return settled.data as T;
}

/** The document at an address of the API that its description has no type for. */
export async function getJson<T>(address: string, signal?: AbortSignal): Promise<T> {
  const headers = { Accept: "application/json" };
  return got<T>(
    fetch(address, { headers, ...(signal ? { signal } : {}) }).then(async (response) =>
      response.ok ? { data: (await response.json()) as T, response } : { response },
    ),
  );
}

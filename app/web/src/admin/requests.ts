/** Requests that change something, and how a large file gets to the service. */
import { ApiProblem, got, problemOf } from "../shared/api";
import { t } from "../shared/texts";

/** Ask for something to be done; the answer's document. */
export async function ask<T>(method: "POST" | "DELETE", address: string): Promise<T> {
  return got<T>(
    fetch(address, { method, headers: { Accept: "application/json" } }).then(async (response) =>
      response.ok ? { data: (await response.json()) as T, response } : { response },
    ),
  );
}

/** Send a file; `told` hears which share has arrived. Aborting `signal` ends it. */
export function send<T>(
  address: string,
  file: File,
  onProgress: (share: number) => void,
  signal: AbortSignal,
): Promise<T> {
  const body = new FormData();
  body.append("file", file, file.name);
  const request = new XMLHttpRequest();
  request.open("POST", address);
  request.setRequestHeader("Accept", "application/json");
  request.responseType = "text";
  return new Promise((resolve, reject) => {
    request.upload.addEventListener("progress", (event) => {
      if (event.lengthComputable) onProgress(event.loaded / event.total);
    });
    request.addEventListener("load", () => {
      const type = request.getResponseHeader("Content-Type") ?? "";
      const { status, statusText } = request;
      const response = new Response(request.responseText, {
        status,
        statusText,
        headers: { "Content-Type": type },
      });
      if (response.ok) resolve(JSON.parse(request.responseText) as T);
      else problemOf(response).then(reject, reject);
    });
    request.addEventListener("error", () =>
      reject(new ApiProblem(0, t("problem.offline"), t("problem.offline"))),
    );
    request.addEventListener("abort", () => reject(new DOMException("aborted", "AbortError")));
    signal.addEventListener("abort", () => request.abort());
    request.send(body);
  });
}

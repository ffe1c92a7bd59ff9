/** Logs this browser in by a key or a login link, and says in words why not. */
import { ApiProblem, api, saidBy } from "../shared/api";
import { duration } from "../shared/format";
import type { Session } from "../shared/session";
import { t } from "../shared/texts";

export type Shown = { key: string } | { link: string };

const WAIT_S = 60;

/** Where the service gives another reason than these, its own words are shown. */
async function refusal(response: Response, read: unknown, shown: Shown): Promise<ApiProblem> {
  const said = await saidBy(response, read);
  const because = (text: string) => new ApiProblem(response.status, said.title, text);
  switch (said.type?.split("/").at(-1)) {
    case "unauthorized":
    case "invalid-request":
      return because(t("link" in shown ? "login.link_void" : "login.wrong_key"));
    case "forbidden":
      return because(t("login.upload_key"));
    case "too-often": {
      const wait = Number(response.headers.get("Retry-After")) || WAIT_S;
      return because(t("login.too_often", { wait: duration(wait) }));
    }
    default:
      return said;
  }
}

/** Log in; throws an `ApiProblem` where that is refused. */
export async function logIn(shown: Shown): Promise<Session> {
  let settled: Awaited<ReturnType<typeof post>>;
  try {
    settled = await post(shown);
  } catch {
    throw new ApiProblem(0, t("problem.offline"), t("problem.offline"));
  }
  if (settled.data === undefined) throw await refusal(settled.response, settled.error, shown);
  return settled.data;
}

const post = (shown: Shown) => api.POST("/v1/session", { body: shown });

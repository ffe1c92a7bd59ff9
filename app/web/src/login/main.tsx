/** Logging in: by a key that is pasted, or by a login link that opens this page. */
import { signal } from "@preact/signals";
import { useEffect, useId, useRef } from "preact/hooks";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { session } from "../shared/session";
import { t } from "../shared/texts";
import { logIn, type Shown } from "./logging_in";
import { linkOf, returnTo } from "./returning";
import "./login.css";

const PROVIDER = "/v1/session/oidc";

const busy = signal(false);
const problem = signal<unknown>(null);

/** The login link, taken out of the address at once: whoever looks over a shoulder or into the history finds none. */
function takeLink(): string | null {
  const link = linkOf(location.hash);
  if (link !== null) history.replaceState(null, "", location.pathname + location.search);
  return link;
}

/** Where the visitor came from, or to what is usual. The way back does not lead here again. */
function goOn(usual: string): void {
  location.replace(returnTo(location.search, location.origin) ?? usual);
}

async function enter(shown: Shown): Promise<void> {
  busy.value = true;
  problem.value = null;
  try {
    await logIn(shown);
    goOn("link" in shown ? "/map" : "/drives");
  } catch (error) {
    problem.value = error;
    busy.value = false;
  }
}

function Already() {
  const owner = session()?.owner;
  if (!owner || busy.value) return null;
  return (
    <p class="card">
      {t("login.already", { owner: owner.name })}{" "}
      <a href={returnTo(location.search, location.origin) ?? "/map"}>{t("login.go_on")}</a>
    </p>
  );
}

/** The way to a provider of logins, where the service has one, which leads to where the visitor came from. */
function ByProvider() {
  const now = session();
  if (!now?.login_provider) return null;
  const there = returnTo(location.search, location.origin);
  const address = there === null ? PROVIDER : `${PROVIDER}?${new URLSearchParams({ return_to: there })}`;
  return (
    <section class="card by-provider">
      {new URLSearchParams(location.search).get("failed") === "provider" && (
        <p class="error-text" role="alert">
          {t("login.provider_failed")}
        </p>
      )}
      <a class="button primary" href={address}>
        {t("login.provider")}
      </a>
    </section>
  );
}

function Form() {
  const field = useRef<HTMLInputElement>(null);
  const id = useId();
  useEffect(() => {
    if (problem.value !== null) field.current?.focus();
  }, [problem.value]);
  return (
    <form
      class="card login"
      onSubmit={(event) => {
        event.preventDefault();
        const key = field.current?.value.trim() ?? "";
        if (key !== "") void enter({ key });
      }}
    >
      <label for={id}>{t("login.key")}</label>
      <input
        ref={field}
        id={id}
        type="password"
        autocomplete="current-password"
        autocapitalize="off"
        spellcheck={false}
        required
        maxLength={200}
        placeholder="vsk_…"
        aria-describedby={`${id}-why`}
      />
      <p id={`${id}-why`} class="error-text" role="alert">
        {problem.value === null ? "" : errorText(problem.value)}
      </p>
      <button type="submit" class="primary" disabled={busy.value}>
        {t(busy.value ? "login.busy" : "login.action")}
      </button>
    </form>
  );
}

function Content() {
  return (
    <Page name="login">
      <div class="login-page">
        <h1>{t("login.title")}</h1>
        <Already />
        <ByProvider />
        <p>{t("login.what")}</p>
        <Form />
        <h2>{t("login.no_key")}</h2>
        <ul>
          <li>{t("login.ask")}</li>
          <li>
            {t("login.operator")} <code>versant keys create</code>
          </li>
          <li>{t("login.logger")}</li>
        </ul>
      </div>
    </Page>
  );
}

function enterByLink(link: string | null): void {
  if (link !== null) void enter({ link });
}

const link = takeLink();
// A link that is opened where this page is open already changes the fragment alone.
addEventListener("hashchange", () => enterByLink(takeLink()));
busy.value = link !== null;
await show("login", Content);
// Where no keys are asked for there is nothing to log in to.
if (session()?.access === "open") goOn("/map");
else enterByLink(link);

/** In the header: who is logged in, the way to their data, the keys and out, or the way in. Nothing where no keys are asked for. */
import { api, got } from "./api";
import { tellError } from "./Messages";
import type { PageName } from "./Page";
import { loginAddress, session } from "./session";
import { t } from "./texts";

async function logOut(): Promise<void> {
  try {
    await got(api.DELETE("/v1/session"));
    location.assign("/map");
  } catch (error) {
    tellError(error);
  }
}

/** The way to log in, and back to what is open then: the map keeps its view in the address. */
export function LogIn({ text, button = false }: { text: string; button?: boolean }) {
  return (
    <a
      class={button ? "button log-in" : undefined}
      href={loginAddress() ?? "/login"}
      onClick={(event) => {
        event.currentTarget.href = loginAddress() ?? "/login";
      }}
    >
      {text}
    </a>
  );
}

export function LoggedIn({ page }: { page: PageName }) {
  const now = session();
  if (now === null || now.access === "open") return null;
  if (now.owner === null) return page === "login" ? null : <LogIn text={t("page.log_in")} button />;
  return (
    <section class="logged-in" aria-label={t("page.logged_in")}>
      <a
        class="owner"
        href="/owner"
        title={now.owner.name}
        aria-label={t("page.owner_named", { name: now.owner.name })}
        aria-current={page === "owner" ? "page" : undefined}
      >
        {now.owner.name}
      </a>
      <a href="/keys" aria-current={page === "keys" ? "page" : undefined}>
        {t("page.keys")}
      </a>
      {/* Only a session ends: who sends a key with each request, as some browsers do, goes on sending it. */}
      {now.expires_at !== null && (
        <button type="button" class="quiet" onClick={() => void logOut()}>
          {t("page.log_out")}
        </button>
      )}
    </section>
  );
}

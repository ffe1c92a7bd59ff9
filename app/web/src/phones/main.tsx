/** Phones and trackers that send points by themselves: addresses for them, and what came last. */
import { useEffect } from "preact/hooks";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { session } from "../shared/session";
import { t } from "../shared/texts";
import { Address } from "./Address";
import { Devices } from "./Devices";
import { Making } from "./Making";
import { LOOK_EVERY_MS, load, look, problem } from "./state";
import "../shared/stacked.css";
import "./phones.css";

/** Names of this machine that mean another one on a phone. */
const HERE_ONLY = /^(localhost|127\.|\[::1\])/;

function Content() {
  useEffect(() => {
    void load();
    const looking = setInterval(() => void look(), LOOK_EVERY_MS);
    return () => clearInterval(looking);
  }, []);
  return (
    <Page name="phones">
      <h1>{t("phones.title")}</h1>
      <p class="intro">
        {t("phones.what")} <a href="/record">{t("phones.by_browser")}</a>
      </p>
      {HERE_ONLY.test(location.hostname) && (
        <p class="card warn-text">{t("phones.here_only", { host: location.host })}</p>
      )}
      {session()?.access === "open" && <p class="card warn-text">{t("phones.open")}</p>}
      {problem.value !== null ? (
        <div class="card" role="alert">
          <p class="error-text">{errorText(problem.value)}</p>
          <button type="button" onClick={() => void load()}>
            {t("phones.try_again")}
          </button>
        </div>
      ) : (
        <>
          <Address />
          <Making />
          <Devices />
        </>
      )}
    </Page>
  );
}

await show("phones", Content);

/** Who may do what: the caller's keys, and for operators the owners. */
import { useEffect } from "preact/hooks";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { session } from "../shared/session";
import { t } from "../shared/texts";
import { Making } from "./Making";
import { Owners } from "./Owners";
import { Secret } from "./Secret";
import { load, problem } from "./state";
import { Table } from "./Table";
import "../shared/stacked.css";
import "./keys.css";

function Content() {
  useEffect(() => void load(), []);
  return (
    <Page name="keys">
      <h1 id="keys">{t("keys.title")}</h1>
      <p>
        {t("keys.what")} <a href="/phones">{t("keys.by_phone")}</a>
      </p>
      {session()?.access === "open" && <p class="card warn-text">{t("keys.open")}</p>}
      {problem.value !== null ? (
        <div class="card" role="alert">
          <p class="error-text">{errorText(problem.value)}</p>
          <button type="button" onClick={() => void load()}>
            {t("keys.try_again")}
          </button>
        </div>
      ) : (
        <>
          <Secret />
          <Table />
          <Making />
          <Owners />
        </>
      )}
    </Page>
  );
}

await show("keys", Content);

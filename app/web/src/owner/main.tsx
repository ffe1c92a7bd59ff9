/** A person's own data: what there is, for how long logs are kept, zones, taking it along, having it removed. */
import { useEffect } from "preact/hooks";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import { Keeping } from "./Keeping";
import { Archive, Removal } from "./Leaving";
import { Receipt } from "./Receipt";
import { figures, load, otherId, problem, removalId } from "./state";
import { Use } from "./Use";
import { Zones } from "./Zones";
import "./owner.css";

function Owner() {
  const now = figures.value;
  if (now === null) return <p class="quiet-text">{t("owner.loading")}</p>;
  if (now.removed_at !== null) return <p class="card">{t("owner.being_removed")}</p>;
  return (
    <>
      <p>{t("owner.what", { name: now.name })}</p>
      <Use of={now} />
      <Keeping of={now} />
      <Zones />
      <Archive />
      <Removal of={now} />
    </>
  );
}

function title(): string {
  if (removalId !== null) return t("owner.receipt");
  return otherId !== null && figures.value
    ? t("owner.title_of", { name: figures.value.name })
    : t("owner.title");
}

function Content() {
  useEffect(() => void load(), []);
  return (
    <Page name="owner">
      <h1>{title()}</h1>
      {problem.value !== null ? (
        <div class="card" role="alert">
          <p class="error-text">{errorText(problem.value)}</p>
          <button type="button" onClick={() => void load()}>
            {t("owner.try_again")}
          </button>
        </div>
      ) : removalId !== null ? (
        <Receipt />
      ) : (
        <Owner />
      )}
    </Page>
  );
}

await show("owner", Content);

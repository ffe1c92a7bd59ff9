import { useEffect } from "preact/hooks";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import { Filters } from "./Filters";
import { Selection } from "./Selection";
import { begin, drives, filtered, go, load, pageTo, problem } from "./state";
import { Table } from "./Table";
import "./drives.css";

function Turn({ rel, text }: { rel: "next" | "prev"; text: string }) {
  const address = pageTo(rel);
  if (address === null) return <span />;
  return (
    <a
      class="button"
      rel={rel}
      href={address}
      onClick={(event) => {
        if (event.ctrlKey || event.metaKey || event.shiftKey) return;
        event.preventDefault();
        go(address);
        scrollTo(0, 0);
        document.getElementById("content")?.focus();
      }}
    >
      {text}
    </a>
  );
}

function Nothing() {
  return (
    <div class="card nothing">
      <p>{t(filtered.value ? "drives.none_found" : "drives.none")}</p>
      {filtered.value ? (
        <a class="button" href="/drives">
          {t("drives.all")}
        </a>
      ) : (
        <a class="button primary" href="/upload">
          {t("drives.upload")}
        </a>
      )}
    </div>
  );
}

function Listed() {
  if (problem.value !== null)
    return (
      <div class="card" role="alert">
        <p class="error-text">{errorText(problem.value)}</p>
        <div class="tools">
          <button type="button" onClick={() => void load()}>
            {t("drives.try_again")}
          </button>
          <a class="button" href="/drives">
            {t("drives.all")}
          </a>
        </div>
      </div>
    );
  if (drives.value === null) return <p class="quiet-text">{t("drives.loading")}</p>;
  if (drives.value.length === 0) return <Nothing />;
  return (
    <>
      <Selection />
      <Table />
      <nav class="turns" aria-label={t("drives.pages")}>
        <Turn rel="prev" text={t("drives.previous")} />
        <Turn rel="next" text={t("drives.next")} />
      </nav>
    </>
  );
}

function Content() {
  useEffect(begin, []);
  return (
    <Page name="drives">
      <div class="title">
        <h1>{t("drives.title")}</h1>
        <a class="button primary" href="/upload">
          {t("drives.upload")}
        </a>
      </div>
      <Filters />
      <Listed />
    </Page>
  );
}

await show("drives", Content);

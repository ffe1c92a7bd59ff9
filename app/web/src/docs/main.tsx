/** The documentation: `/docs` lists the guides and tells the API, `/docs/{name}` is one guide. */
import { useEffect, useState } from "preact/hooks";
import { getJson } from "../shared/api";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import "./docs.css";
import { GuideText } from "./Guide";
import { type ApiDocument, groupsOf, matching } from "./openapi";
import { Prose } from "./Prose";
import { Reference } from "./Reference";
import { Sidebar } from "./Sidebar";
import { guideNamed, guidesWith, shelves } from "./shelves";

const current = location.pathname.split("/")[2] || null;

function Books({ words }: { words: string[] }) {
  const found = new Set(guidesWith(words));
  const shown = shelves()
    .map(([shelf, books]) => [shelf, books.filter((one) => found.has(one))] as const)
    .filter(([, books]) => books.length > 0);
  return (
    <>
      {shown.map(([shelf, books]) => (
        <section key={shelf} aria-labelledby={`shelf-${shelf}`}>
          <h3 id={`shelf-${shelf}`}>{t(`docs.shelf.${shelf}`)}</h3>
          <ul class="books" lang="en">
            {books.map((one) => (
              <li key={one.name} class="card">
                <a href={`/docs/${one.name}`}>{one.title}</a>
                <p class="quiet-text">{one.summary}</p>
              </li>
            ))}
          </ul>
        </section>
      ))}
    </>
  );
}

function Start({ document: api, problem }: { document: ApiDocument | null; problem: string | null }) {
  const [query, setQuery] = useState("");
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  const groups = api ? matching(groupsOf(api), words) : [];
  const operations = groups.reduce((sum, group) => sum + group.operations.length, 0);
  const books = guidesWith(words).length;
  useEffect(() => {
    const place = api && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (place) place.scrollIntoView();
  }, [api]);
  return (
    <article>
      <h1>{t("page.docs")}</h1>
      <p>{t("docs.introduction")}</p>
      <div class="search">
        <label for="search">{t("docs.search")}</label>
        <input
          id="search"
          type="search"
          value={query}
          onInput={(event) => setQuery(event.currentTarget.value)}
        />
        <span role="status" class="quiet-text">
          {words.length > 0 && api && t("docs.found", { n: operations, guides: books })}
        </span>
      </div>
      {books > 0 && <h2 id="guides">{t("docs.guides")}</h2>}
      <Books words={words} />
      <h2 id="api">{t("docs.api")}</h2>
      {problem !== null && <p class="error-text">{problem}</p>}
      {api && (
        <>
          {words.length === 0 && <Prose text={api.info.description} />}
          <p class="quiet-text">
            {t("docs.version", { version: api.info.version })}{" "}
            <a href="/openapi.json?f=json">{t("docs.document", { version: "3.1" })}</a>,{" "}
            <a href="/openapi.json?f=openapi-3.0">{t("docs.document", { version: "3.0" })}</a>,{" "}
            <a href="/openapi.json?f=html">{t("docs.plain")}</a>
          </p>
          {operations === 0 && <p>{t("docs.nothing_found")}</p>}
          <Reference groups={groups} document={api} />
        </>
      )}
      {!api && problem === null && <p class="quiet-text">{t("docs.loading")}</p>}
    </article>
  );
}

function Content() {
  const [api, setApi] = useState<ApiDocument | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  useEffect(() => {
    if (current !== null) return;
    getJson<ApiDocument>("/openapi.json").then(setApi, (error) => setProblem(errorText(error)));
  }, []);
  return (
    <Page name="docs">
      <div class="docs">
        <Sidebar current={current} groups={api ? groupsOf(api) : []} />
        {current === null ? <Start document={api} problem={problem} /> : <GuideText name={current} />}
      </div>
    </Page>
  );
}

await show("docs", Content);
const guide = current === null ? undefined : guideNamed(current);
if (guide) document.title = `${guide.title} – Versant`;

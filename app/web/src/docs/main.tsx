/** The documentation: `/docs` lists the guides and describes the API, `/docs/{name}` is one guide. */
import { useEffect, useLayoutEffect, useState } from "preact/hooks";
import { goTo, lookedAt, search } from "../shared/address";
import { getJson } from "../shared/api";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import "./docs.css";
import { inLanguage, type Section, sectionsWith } from "./contents";
import { GuideText, guideTitle, removeServed } from "./Guide";
import { type ApiDocument, groupsOf, matching } from "./openapi";
import { Prose } from "./Prose";
import { Reference } from "./Reference";
import { Sidebar } from "./Sidebar";

const current = location.pathname.replace(/^\/docs\/?/, "") || null;

function Books({ sections }: { sections: Section[] }) {
  return (
    <>
      {sections.map((section, n) => (
        <section key={section.title} aria-labelledby={`section-${n}`}>
          <h3 id={`section-${n}`}>{section.title}</h3>
          <ul class="books">
            {section.pages.map((page) => (
              <li key={page.name} class="card">
                <a href={`/docs/${page.name}`}>{page.title}</a>
                <p class="quiet-text">{page.summary}</p>
              </li>
            ))}
          </ul>
        </section>
      ))}
    </>
  );
}

interface StartProps {
  sections: Section[];
  document: ApiDocument | null;
  problem: string | null;
}

function Start({ sections, document: api, problem }: StartProps) {
  const query = new URLSearchParams(search.value).get("q") ?? "";
  const setQuery = (text: string) => {
    const asked = text === "" ? "" : `?${new URLSearchParams({ q: text })}`;
    goTo(location.pathname + asked + location.hash, query !== "" && text !== "");
  };
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  const groups = api ? matching(groupsOf(api), words) : [];
  const operations = groups.reduce((sum, group) => sum + group.operations.length, 0);
  const found = sectionsWith(sections, words);
  const books = found.reduce((sum, section) => sum + section.pages.length, 0);
  useEffect(() => {
    if (api) document.getElementById(lookedAt.peek())?.scrollIntoView();
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
          {words.length > 0 &&
            api &&
            t("docs.found", { n: operations, guides: t("docs.found_guides", { n: books }) })}
        </span>
      </div>
      {books > 0 && <h2 id="guides">{t("docs.guides")}</h2>}
      <Books sections={found} />
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
  const [sections, setSections] = useState<Section[]>([]);
  const [problem, setProblem] = useState<string | null>(null);
  useLayoutEffect(removeServed, []);
  useEffect(() => {
    getJson<Section[]>("/docs/contents.json").then(
      (all) => setSections(inLanguage(all)),
      (error) => setProblem(errorText(error)),
    );
    if (current !== null) return;
    getJson<ApiDocument>("/openapi.json").then(setApi, (error) => setProblem(errorText(error)));
  }, []);
  return (
    <Page name="docs">
      <div class="docs">
        <Sidebar current={current} sections={sections} groups={api ? groupsOf(api) : []} />
        {current === null ? (
          <Start sections={sections} document={api} problem={problem} />
        ) : (
          <GuideText name={current} />
        )}
      </div>
    </Page>
  );
}

await show("docs", Content);
if (current !== null && guideTitle) document.title = `${guideTitle} – Versant`;

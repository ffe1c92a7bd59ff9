/** What every page has around it: the way to the others, language, colours, a place for messages. */
import { type ComponentChildren, type ComponentType, render } from "preact";
import { LoggedIn } from "./LoggedIn";
import { Messages } from "./Messages";
import { RoadsNotice, watchRoads } from "./roads";
import { loadSaid } from "./said";
import { askSession, isNobody, may, session, toLogin } from "./session";
import {
  chooseLanguage,
  currentLanguage,
  type Language,
  languages,
  loadTexts,
  type TextKey,
  t,
} from "./texts";
import { switchTheme, theme } from "./theme";
import "./style.css";

const PAGES = ["map", "upload", "drives", "admin", "docs"] as const;
export type PageName = (typeof PAGES)[number] | "keys" | "login" | "owner" | "phones" | "record";
/** Pages for operators alone. */
const OPERATORS: readonly PageName[] = ["admin"];
/** Pages for everybody. */
const OPEN: readonly PageName[] = ["docs", "login"];
/** Pages that show sentences of the service at once. */
const SAYING: readonly PageName[] = ["admin", "docs", "drives", "record", "upload"];

/** Pages that say so where there are no roads yet. The map says it in its own place. */
const NEED_ROADS: readonly PageName[] = ["upload", "drives", "admin"];

interface PageProps {
  name: PageName;
  /** The map fills the window; other pages scroll. */
  filled?: boolean;
  children: ComponentChildren;
}

/** The frame of a page. */
export function Page({ name, filled = false, children }: PageProps) {
  return (
    <div class={filled ? "page filled" : "page"}>
      <a class="skip" href="#content">
        {t("page.skip")}
      </a>
      <header class="top">
        <a class="brand" href="/map">
          <img src="/web/icon.svg" alt="" width="24" height="24" /> Versant
        </a>
        <nav aria-label={t("page.navigation")}>
          {PAGES.filter((one) => may("operate") || !OPERATORS.includes(one)).map((one) => (
            <a key={one} href={`/${one}`} aria-current={one === name ? "page" : undefined}>
              {t(`page.${one}` as TextKey)}
            </a>
          ))}
        </nav>
        <LoggedIn page={name} />
        <div class="settings">
          <label>
            <span class="unseen">{t("page.language")}</span>
            <select
              value={currentLanguage()}
              onChange={(event) => chooseLanguage(event.currentTarget.value as Language)}
            >
              {languages.map(([code, own]) => (
                <option key={code} value={code}>
                  {own}
                </option>
              ))}
            </select>
          </label>
          <button
            type="button"
            class="quiet"
            onClick={switchTheme}
            aria-label={t(`page.to_${theme.value === "dark" ? "light" : "dark"}`)}
          >
            {theme.value === "dark" ? "☀" : "☾"}
          </button>
        </div>
      </header>
      {NEED_ROADS.includes(name) && <RoadsNotice />}
      <main id="content" tabIndex={-1}>
        {children}
      </main>
      <Messages />
    </div>
  );
}

/** A receipt is for whoever has its address. */
const isReceipt = (name: PageName) => name === "owner" && new URLSearchParams(location.search).has("removal");

/** Whether nobody sees the page: the map is shown to nobody where the service says so. */
function asksForKey(name: PageName): boolean {
  const seen =
    OPEN.includes(name) || isReceipt(name) || (name === "map" && (session()?.public_map ?? "off") !== "off");
  return isNobody() && !seen;
}

function ForOperators({ name }: { name: PageName }) {
  return (
    <Page name={name}>
      <div class="card refused">
        <h1>{t("page.for_operators")}</h1>
        <p>{t("page.for_operators_do")}</p>
      </div>
    </Page>
  );
}

/** Show a page in the visitor's language, or lead to where one logs in. */
export async function show(name: PageName, Content: ComponentType): Promise<void> {
  await Promise.all([loadTexts().then(() => (SAYING.includes(name) ? loadSaid() : undefined)), askSession()]);
  if (asksForKey(name)) return toLogin();
  document.title = `${t(`page.${name}` as TextKey)} – Versant`;
  const place = document.getElementById("page");
  if (NEED_ROADS.includes(name)) watchRoads();
  const refused = OPERATORS.includes(name) && !may("operate");
  if (place) render(refused ? <ForOperators name={name} /> : <Content />, place);
}

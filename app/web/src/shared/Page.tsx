/** What every page has around it: the way to the others, language, colours, a place for messages. */
import { type ComponentChildren, type ComponentType, render } from "preact";
import { Messages } from "./Messages";
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
export type PageName = (typeof PAGES)[number];

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
          {PAGES.map((one) => (
            <a key={one} href={`/${one}`} aria-current={one === name ? "page" : undefined}>
              {t(`page.${one}` as TextKey)}
            </a>
          ))}
        </nav>
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
      <main id="content" tabIndex={-1}>
        {children}
      </main>
      <Messages />
    </div>
  );
}

/** Show a page in the visitor's language. */
export async function show(name: PageName, Content: ComponentType): Promise<void> {
  await loadTexts();
  document.title = `${t(`page.${name}` as TextKey)} – Versant`;
  const place = document.getElementById("page");
  if (place) render(<Content />, place);
}

/** What the service tells its pages: written by app/web/pages.py into the page's `<meta name="versant">`. */
export interface PageConfig {
  /** Version of the service. */
  version: string;
  /** A MapLibre style that is drawn below the roads, from another host perhaps (VERSANT_MAP_BACKGROUND_URL). */
  background_style_url: string | null;
  /** Others that may be chosen, by name (VERSANT_MAP_BACKGROUNDS). */
  backgrounds: Record<string, string>;
  /** Where whoever is answered 401 goes to log in; null: there is no login. */
  login_url: string | null;
}

const json = document.querySelector<HTMLMetaElement>('meta[name="versant"]')?.content ?? "{}";

export const config: PageConfig = {
  version: "",
  background_style_url: null,
  backgrounds: {},
  login_url: null,
  ...(JSON.parse(json) as Partial<PageConfig>),
};

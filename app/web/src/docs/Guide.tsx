/** One page of the documentation: the text that the service put into this page. Nothing in it came from a visitor. */
import { useEffect, useRef } from "preact/hooks";
import { lookedAt } from "../shared/address";
import { t } from "../shared/texts";

/** What the service put into the page; null: there is no such page. */
const served = document.querySelector("#page > article.guide");
const guideHtml = served?.innerHTML ?? null;
export const guideTitle = served?.querySelector("h1")?.textContent ?? null;

/** Takes the served text away: call it when the page is drawn, which shows it in its place. */
export function removeServed(): void {
  served?.remove();
}

/** The text, or that there is none of that name. */
export function GuideText({ name }: { name: string }) {
  const article = useRef<HTMLElement>(null);
  useEffect(() => {
    // The text was drawn anew after the browser looked for what the address names.
    const place = document.getElementById(lookedAt.peek());
    if (place && article.current?.contains(place)) place.scrollIntoView();
  }, []);
  if (guideHtml === null) {
    return (
      <article>
        <h1>{t("docs.no_guide")}</h1>
        <p>{t("docs.no_guide_named", { name })}</p>
      </article>
    );
  }
  return <article ref={article} lang="en" class="guide" dangerouslySetInnerHTML={{ __html: guideHtml }} />;
}

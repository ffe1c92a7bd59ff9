/** One guide. Its HTML was made from `.docs/*.md` when the pages were built: nothing in it came from a visitor. */
import { useEffect, useRef, useState } from "preact/hooks";
import { errorText } from "../shared/Messages";
import { t } from "../shared/texts";
import { guideNamed } from "./shelves";

/** The guide of that name, or that there is none. */
export function GuideText({ name }: { name: string }) {
  const guide = guideNamed(name);
  const [html, setHtml] = useState<string | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  const article = useRef<HTMLElement>(null);
  useEffect(() => {
    guide?.load().then(
      (loaded) => setHtml(loaded.default),
      (error) => setProblem(errorText(error)),
    );
  }, [guide]);
  useEffect(() => {
    // The text came after the address was looked at.
    const place = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (html !== null && place && article.current?.contains(place)) place.scrollIntoView();
  }, [html]);

  if (!guide) {
    return (
      <article>
        <h1>{t("docs.no_guide")}</h1>
        <p>{t("docs.no_guide_named", { name })}</p>
      </article>
    );
  }
  if (problem !== null) return <p class="error-text">{problem}</p>;
  if (html === null) return <p class="quiet-text">{t("docs.loading")}</p>;
  return <article ref={article} lang="en" class="guide" dangerouslySetInnerHTML={{ __html: html }} />;
}

/** Where one is in the documentation, and the way to the rest: beside the text, or folded above it on a phone. */
import { useState } from "preact/hooks";
import { t } from "../shared/texts";
import type { Group } from "./openapi";
import { guideNamed, shelves } from "./shelves";

const WIDE = matchMedia("(min-width: 60rem)");

function Headings({ name }: { name: string }) {
  const guide = guideNamed(name);
  if (!guide || guide.headings.length < 2) return null;
  return (
    <ul lang="en">
      {guide.headings.map((one) => (
        <li key={one.id}>
          <a href={`#${one.id}`}>{one.text}</a>
        </li>
      ))}
    </ul>
  );
}

/** `current` is the guide that is shown; null: the start. */
export function Sidebar({ current, groups }: { current: string | null; groups: Group[] }) {
  const [open] = useState(WIDE.matches);
  return (
    <details class="sidebar" open={open}>
      <summary>{t("docs.contents")}</summary>
      <nav aria-label={t("docs.contents")}>
        <p>
          <a href="/docs" aria-current={current === null ? "page" : undefined}>
            {t("docs.start")}
          </a>
        </p>
        {shelves().map(([shelf, books]) => (
          <div key={shelf}>
            <h2>{t(`docs.shelf.${shelf}`)}</h2>
            <ul>
              {books.map((one) => (
                <li key={one.name}>
                  <a
                    href={`/docs/${one.name}`}
                    lang="en"
                    aria-current={one.name === current ? "page" : undefined}
                  >
                    {one.title}
                  </a>
                  {one.name === current && <Headings name={one.name} />}
                </li>
              ))}
            </ul>
          </div>
        ))}
        <h2>
          <a href="/docs#api">{t("docs.api")}</a>
        </h2>
        <ul lang="en">
          {groups.map((group) => (
            <li key={group.tag}>
              <a href={`#${group.tag}`}>{group.tag}</a>
            </li>
          ))}
        </ul>
      </nav>
    </details>
  );
}

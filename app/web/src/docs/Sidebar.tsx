/** Where one is in the documentation, and the way to the rest: beside the text, or folded above it on a phone. */
import { useState } from "preact/hooks";
import { t } from "../shared/texts";
import type { Guide, Section } from "./contents";
import type { Group } from "./openapi";

const WIDE = matchMedia("(min-width: 60rem)");

function Headings({ page }: { page: Guide }) {
  if (page.headings.length < 2) return null;
  return (
    <ul lang="en">
      {page.headings.map((one) => (
        <li key={one.id}>
          <a href={`#${one.id}`}>{one.text}</a>
        </li>
      ))}
    </ul>
  );
}

interface SidebarProps {
  /** The page that is shown; null: the start. */
  current: string | null;
  sections: Section[];
  groups: Group[];
}

export function Sidebar({ current, sections, groups }: SidebarProps) {
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
        {sections.map((section) => (
          <div key={section.title}>
            <h2>{section.title}</h2>
            <ul>
              {section.pages.map((page) => (
                <li key={page.name}>
                  <a href={`/docs/${page.name}`} aria-current={page.name === current ? "page" : undefined}>
                    {page.title}
                  </a>
                  {page.name === current && <Headings page={page} />}
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

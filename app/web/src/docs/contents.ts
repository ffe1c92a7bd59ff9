/** What pages the documentation has, as the service lists them (`docs/index.md`). */
import { term } from "../shared/said";

export interface Guide {
  /** Its path below `/docs/`. */
  name: string;
  title: string;
  /** A sentence that says what it is for. */
  summary: string;
  /** Headings below the title, of the second level. */
  headings: { id: string; text: string }[];
}

export interface Section {
  title: string;
  pages: Guide[];
}

/** Titles and summaries in the language of the page, so that they are shown and found in it. */
export function inLanguage(sections: Section[]): Section[] {
  return sections.map((section) => ({
    title: term(section.title),
    pages: section.pages.map((one) => ({ ...one, title: term(one.title), summary: term(one.summary) })),
  }));
}

/** The sections with those pages in whose title, summary or headings every word occurs; empty sections are left out. */
export function sectionsWith(sections: Section[], words: string[]): Section[] {
  return sections
    .map((section) => ({ ...section, pages: section.pages.filter((page) => matches(page, words)) }))
    .filter((section) => section.pages.length > 0);
}

function matches(page: Guide, words: string[]): boolean {
  const text = [page.title, page.summary, ...page.headings.map((one) => one.text)].join(" ").toLowerCase();
  return words.every((word) => text.includes(word));
}

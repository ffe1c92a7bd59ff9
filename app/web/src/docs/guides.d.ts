/** What plugins/guides.ts makes of `.docs/*.md`. */
declare module "virtual:guides" {
  export interface Guide {
    name: string;
    title: string;
    summary: string;
    headings: { id: string; text: string }[];
    /** Its HTML, made when the pages were built. */
    load: () => Promise<{ default: string }>;
  }
  export const guides: Guide[];
}

/** What needs a person, the most urgent first; each with what to do and the way there. */
import { duration, number } from "../../shared/format";
import { hasText, t } from "../../shared/texts";
import type texts from "../../texts/en.json";
import { ownAddress } from "../links";
import { useQuery } from "../page_state";
import { Loaded } from "../parts/Section";
import type { Attention as Row } from "../types";

// Where on this page something can be done about it.
const SECTIONS: Record<string, keyof typeof texts.admin.parts> = {
  worker: "queue",
  wait: "queue",
  cell: "queue",
  disk: "room",
  failed: "failures",
  "operation-planned": "roads",
  "operation-failed": "roads",
};

function Item({ row }: { row: Row }) {
  const kind = `admin.attention.kinds.${row.kind.replaceAll("-", "_")}`;
  const [title, todo] = [`${kind}.title`, `${kind}.todo`];
  const name = hasText(title) ? t(title) : row.what;
  const list = ownAddress(row.link);
  const section = SECTIONS[row.kind];
  return (
    <li class={row.severity}>
      <h3>
        <span class="severity">{t(`admin.attention.${row.severity}`)}</span> {name}
        {row.count > 1 && <span class="count"> · {number(row.count)}</span>}
      </h3>
      <p lang="en">{row.what}</p>
      {hasText(todo) && <p>{t(todo)}</p>}
      <p class="facts">
        {row.oldest_s !== null && (
          <span>{t("admin.attention.oldest", { time: duration(row.oldest_s) })}</span>
        )}
        {list && (
          <a href={list} aria-label={t("admin.attention.list_of", { title: name })}>
            {t("admin.attention.list")}
          </a>
        )}
        {section && (
          <a href={`#${section}`}>{t("admin.attention.there", { title: t(`admin.parts.${section}`) })}</a>
        )}
      </p>
    </li>
  );
}

export function Attention() {
  const reading = useQuery<Row>("attention", 10);
  return (
    <Loaded of={reading}>
      {({ rows }) => (
        <>
          <p class="unseen" role="status">
            {t("admin.attention.status", { n: rows.length })}
          </p>
          {rows.length === 0 ? (
            <p class="calm">{t("admin.attention.none")}</p>
          ) : (
            <ul class="attention">
              {rows.map((row) => (
                <Item key={`${row.kind} ${row.what}`} row={row} />
              ))}
            </ul>
          )}
        </>
      )}
    </Loaded>
  );
}

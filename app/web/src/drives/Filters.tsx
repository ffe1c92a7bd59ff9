/** What the list is searched and narrowed by. */
import { useEffect, useRef } from "preact/hooks";
import { dayOf, midnight } from "../shared/days";
import { failureText } from "../shared/remarks";
import { type TextKey, t } from "../shared/texts";
import {
  addressWith,
  filtered,
  go,
  order,
  query,
  SORTS,
  type Sort,
  STATUSES,
  sort,
  usualOrder,
} from "./state";

const FAILURES = [
  "no-match",
  "no-roads",
  "empty-log",
  "bad-log",
  "malformed-log",
  "unknown-format",
  "missing-sensor",
  "too-long",
  "method-failed",
  "out-of-memory",
  "processing-failed",
  "internal",
];
const TYPING_MS = 250;
/** Stands among the statuses: drives that failed for the service, and wait for people. */
const ROADS = "roads";

/** The address of the drives of a status; what waits for roads is no failure. */
function addressOf(status: string): string {
  if (status === ROADS) return addressWith({ status: null, failure: null, waits_for: "roads" });
  return addressWith({ status, failure: null, waits_for: status === "failed" ? "nothing" : null });
}

function Search() {
  const field = useRef<HTMLInputElement>(null);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const searched = query.value.get("q") ?? "";
  const written = useRef(searched);
  // Whether the address has letters of what is being typed: the back button leads to the list before them.
  const typing = useRef(false);
  useEffect(() => {
    if (!field.current || searched === written.current) return;
    // Another address than this field's, by the back button or a link.
    clearTimeout(timer.current);
    typing.current = false;
    written.current = searched;
    field.current.value = searched;
  }, [searched]);
  const search = () => {
    clearTimeout(timer.current);
    const text = (field.current?.value ?? "").trim();
    if (text === searched) return;
    written.current = text;
    go(addressWith({ q: text }), typing.current);
    typing.current = true;
  };
  const end = () => {
    search();
    typing.current = false;
  };
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault();
        end();
      }}
    >
      <label>
        <span>{t("drives.search")}</span>
        <input
          ref={field}
          type="search"
          maxLength={100}
          defaultValue={searched}
          placeholder={t("drives.search_example")}
          onInput={() => {
            clearTimeout(timer.current);
            timer.current = setTimeout(search, TYPING_MS);
          }}
          onBlur={end}
        />
      </label>
    </form>
  );
}

function Days() {
  const since = query.value.get("created_after");
  const until = query.value.get("created_before");
  return (
    <>
      <label>
        <span>{t("drives.uploaded_from")}</span>
        <input
          type="date"
          value={dayOf(since)}
          onChange={(event) => go(addressWith({ created_after: midnight(event.currentTarget.value) }))}
        />
      </label>
      <label>
        <span>{t("drives.uploaded_to")}</span>
        <input
          type="date"
          value={dayOf(until, 1)}
          onChange={(event) => go(addressWith({ created_before: midnight(event.currentTarget.value, 1) }))}
        />
      </label>
    </>
  );
}

function Order() {
  const value = `${sort.value} ${order.value}`;
  return (
    <label class="phone-only">
      <span>{t("drives.order")}</span>
      <select
        value={value}
        onChange={(event) => {
          const [by, way] = event.currentTarget.value.split(" ") as [Sort, "asc" | "desc"];
          go(sortedBy(by, way));
        }}
      >
        {SORTS.flatMap((one) =>
          (["desc", "asc"] as const).map((way) => (
            <option key={one + way} value={`${one} ${way}`}>
              {t(`drives.by.${one}_${way}` as TextKey)}
            </option>
          )),
        )}
      </select>
    </label>
  );
}

/** The address of the list in that order. */
export function sortedBy(by: Sort, way: "asc" | "desc"): string {
  return addressWith({ sort: by === "created_at" ? null : by, order: way === usualOrder(by) ? null : way });
}

/** All of them. */
export function Filters() {
  const failure = query.value.get("failure") ?? "";
  const kinds = failure && !FAILURES.includes(failure) ? [failure, ...FAILURES] : FAILURES;
  const waits = query.value.get("waits_for") === "roads";
  const status = waits ? ROADS : (query.value.get("status") ?? (failure ? "failed" : ""));
  return (
    <section class="filters" aria-label={t("drives.filters")}>
      <Search />
      <label>
        <span>{t("drives.status")}</span>
        <select value={status} onChange={(event) => go(addressOf(event.currentTarget.value))}>
          <option value="">{t("drives.any")}</option>
          {STATUSES.map((one) => (
            <option key={one} value={one}>
              {t(`drives.is.${one}`)}
            </option>
          ))}
          <option value={ROADS}>{t("roads.waits")}</option>
        </select>
      </label>
      {status === "failed" && (
        <label>
          <span>{t("drives.reason")}</span>
          <select
            value={failure}
            onChange={(event) => go(addressWith({ status: "failed", failure: event.currentTarget.value }))}
          >
            <option value="">{t("drives.any")}</option>
            {kinds.map((one) => (
              <option key={one} value={one}>
                {failureText(one)}
              </option>
            ))}
          </select>
        </label>
      )}
      <Days />
      <Order />
      {filtered.value && (
        <a
          class="button"
          href="/drives"
          onClick={(event) => {
            event.preventDefault();
            go("/drives");
          }}
        >
          {t("drives.all")}
        </a>
      )}
    </section>
  );
}

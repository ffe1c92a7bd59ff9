/** The address that was just made: as a code, as what is typed, and whether it works. */
import { useEffect, useRef } from "preact/hooks";
import { copy } from "../shared/clipboard";
import { tellDone, tellError } from "../shared/Messages";
import { type TextKey, t } from "../shared/texts";
import { Code } from "./Code";
import { made, seenBy, wordOf } from "./state";

export function Address() {
  const card = useRef<HTMLElement>(null);
  const now = made.value;
  useEffect(() => card.current?.focus(), [now]);
  if (now === null) return null;
  const press = () =>
    copy(now.typed, t("phones.copy_refused")).then(
      () => tellDone(t("phones.copied")),
      (error) => tellError(error instanceof Error ? error.message : error),
    );
  const works = seenBy(now.key.id) !== undefined;
  return (
    <section class="card made" ref={card} tabIndex={-1} aria-labelledby="made">
      <h2 id="made">{t("phones.made", { label: now.key.label })}</h2>
      <p>
        <b>{t("phones.once")}</b>
      </p>
      <div class="ways">
        {now.sender.name !== "traccar" && (
          <figure>
            <Code text={now.link ?? now.typed} label={t("phones.scan")} />
            <figcaption>
              {t("phones.scan")}
              {now.link !== null && (
                <>
                  {" · "}
                  <a href={now.link}>{t("phones.open_link")}</a>
                </>
              )}
            </figcaption>
          </figure>
        )}
        <div>
          <h3>{t("phones.typed", { program: now.sender.title })}</h3>
          <pre>
            <code>{now.typed}</code>
          </pre>
          <p>{t(`phones.steps.${wordOf(now.sender.name)}` as TextKey)}</p>
          <div class="tools">
            <button type="button" class="primary" onClick={press}>
              {t("phones.copy")}
            </button>
            <button
              type="button"
              onClick={() => {
                made.value = null;
                document.getElementById("content")?.focus();
              }}
            >
              {t("phones.kept")}
            </button>
          </div>
        </div>
      </div>
      <p class={works ? "works" : "quiet-text"} role="status">
        {works ? t("phones.works") : t("phones.waits")}
      </p>
    </section>
  );
}

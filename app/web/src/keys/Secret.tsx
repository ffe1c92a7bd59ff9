/** A secret that has just been made, once. */
import { useEffect, useRef } from "preact/hooks";
import { copy } from "../shared/clipboard";
import { tellDone, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import { told } from "./state";

export function Secret() {
  const card = useRef<HTMLElement>(null);
  const now = told.value;
  useEffect(() => card.current?.focus(), [now]);
  if (now === null) return null;
  const press = () =>
    copy(now.secret, t("keys.copy_refused")).then(
      () => tellDone(t("keys.copied")),
      (error) => tellError(error instanceof Error ? error.message : error),
    );
  return (
    <section class="card secret" ref={card} tabIndex={-1} aria-labelledby="secret">
      <h2 id="secret">{t("keys.secret", { label: now.label })}</h2>
      <p>
        <code>{now.secret}</code>
      </p>
      <p>
        <b>{t("keys.once")}</b> {t("keys.use")}
      </p>
      <div class="tools">
        <button type="button" class="primary" onClick={press}>
          {t("keys.copy")}
        </button>
        <button
          type="button"
          onClick={() => {
            told.value = null;
            document.getElementById("content")?.focus();
          }}
        >
          {t("keys.kept")}
        </button>
      </div>
    </section>
  );
}

/** Taking all along, and having all removed. */
import { useSignal } from "@preact/signals";
import { confirmed } from "../shared/Confirm";
import { useSending } from "../shared/sending";
import { t } from "../shared/texts";
import { ARCHIVE, type Figures, removeOwner } from "./state";

/** What nobody else owns is its. */
const OPERATOR = 1;

export function Archive() {
  return (
    <section class="card" aria-labelledby="archive">
      <h2 id="archive">{t("owner.archive")}</h2>
      <p>{t("owner.archive_what")}</p>
      <a class="button" href={ARCHIVE} download>
        {t("owner.fetch")}
      </a>
    </section>
  );
}

function Confirming({ of: { name } }: { of: Figures }) {
  const typed = useSignal("");
  const remove = async () => location.replace(await removeOwner(name));
  const agreed = () =>
    confirmed({
      title: t("owner.remove_title", { name }),
      what: <p>{t("owner.remove_last")}</p>,
      action: t("owner.remove"),
      destructive: true,
    });
  const { busy, submit, failure } = useSending(remove, agreed);
  return (
    <form class="confirming" onSubmit={submit}>
      <label class="field">
        <span>{t("owner.type_name", { name })}</span>
        <input
          value={typed.value}
          required
          autocomplete="off"
          onInput={(event) => {
            typed.value = event.currentTarget.value;
          }}
        />
      </label>
      <button type="submit" class="danger" disabled={busy || typed.value.trim() !== name}>
        {t("owner.remove")}
      </button>
      {failure}
    </form>
  );
}

export function Removal({ of: owner }: { of: Figures }) {
  const stays = owner.id === OPERATOR;
  return (
    <section class="card removal" aria-labelledby="removal">
      <h2 id="removal">{t("owner.removal")}</h2>
      <p>{stays ? t("owner.operator_stays") : t("owner.removal_what", { n: owner.drives })}</p>
      {!stays && <Confirming of={owner} />}
    </section>
  );
}

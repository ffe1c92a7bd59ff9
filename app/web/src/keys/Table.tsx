/** The keys, and what can be done with each. */
import { useSignal } from "@preact/signals";
import { confirmed } from "../shared/Confirm";
import { dayText, moment, UNKNOWN } from "../shared/format";
import { tellDone, tellError } from "../shared/Messages";
import { may } from "../shared/session";
import { t } from "../shared/texts";
import { inOrder, isOwn, type Key, keys, revokeKey, rotateKey, stateOf } from "./state";

/** A day without its time: the service keeps no more of a key's use. */
function day(on: string | null): string {
  if (on === null) return t("keys.never");
  return dayText(on);
}

interface Act {
  title: string;
  /** What it does to whoever uses the key, and to the visitor, where it is theirs. */
  what: string;
  own: string;
  action: string;
  destructive: boolean;
  run: (key: Key) => Promise<void>;
  done: string;
}

function rotation(key: Key): Act {
  return {
    title: t("keys.rotate_title", { label: key.label }),
    what: t("keys.rotate_what"),
    own: t("keys.rotate_own"),
    action: t("keys.rotate"),
    destructive: false,
    run: rotateKey,
    done: t("keys.rotated", { label: key.label }),
  };
}

function revocation(key: Key): Act {
  return {
    title: t("keys.revoke_title", { label: key.label }),
    what: t("keys.revoke_what", { owner: key.owner.name, used: day(key.last_used_on) }),
    own: t("keys.revoke_own"),
    action: t("keys.revoke"),
    destructive: true,
    run: revokeKey,
    done: t("keys.revoked", { label: key.label }),
  };
}

function Actions({ of: key }: { of: Key }) {
  const busy = useSignal(false);
  const act = async ({ title, what, own, action, destructive, run, done }: Act) => {
    const said = (
      <>
        <p>{what}</p>
        {isOwn(key) && <p class="warn-text">{own}</p>}
      </>
    );
    if (!(await confirmed({ title, what: said, action, destructive }))) return;
    busy.value = true;
    try {
      await run(key);
      tellDone(done);
    } catch (error) {
      tellError(error);
    }
    busy.value = false;
  };
  return (
    <div class="tools">
      <button
        type="button"
        disabled={busy.value}
        aria-label={t("keys.rotate_named", { label: key.label })}
        onClick={() => void act(rotation(key))}
      >
        {t("keys.rotate")}
      </button>
      <button
        type="button"
        class="danger"
        disabled={busy.value}
        aria-label={t("keys.revoke_named", { label: key.label })}
        onClick={() => void act(revocation(key))}
      >
        {t("keys.revoke")}
      </button>
    </div>
  );
}

function Row({ of: key }: { of: Key }) {
  const state = stateOf(key, Date.now());
  return (
    <tr class={state}>
      <th scope="row">
        {key.label}
        {isOwn(key) && <span class="quiet-text"> {t("keys.yours")}</span>}
      </th>
      <td data-label={t("keys.scope")}>
        <code>{key.scope}</code>
      </td>
      <td data-label={t("keys.owner")}>{key.owner.name}</td>
      <td data-label={t("keys.created")}>{moment(key.created_at)}</td>
      <td data-label={t("keys.expires")}>
        {key.expires_at === null ? t("keys.never") : moment(key.expires_at)}
      </td>
      <td data-label={t("keys.used")}>{day(key.last_used_on)}</td>
      <td data-label={t("keys.state")} class={state === "active" ? "" : "warn-text"}>
        <span>
          {t(`keys.is.${state}`)}
          {key.revoked_at !== null && <small> {moment(key.revoked_at)}</small>}
        </span>
      </td>
      <td class="actions">{state !== "revoked" && may(key.scope) ? <Actions of={key} /> : UNKNOWN}</td>
    </tr>
  );
}

export function Table() {
  if (keys.value === null) return <p class="quiet-text">{t("keys.loading")}</p>;
  if (keys.value.length === 0) return <p class="card">{t("keys.none")}</p>;
  return (
    // biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is reached by keyboard
    <section class="wide" tabIndex={0} aria-labelledby="keys">
      <table class="keys stacked">
        <thead>
          <tr>
            <th scope="col">{t("keys.label")}</th>
            <th scope="col">{t("keys.scope")}</th>
            <th scope="col">{t("keys.owner")}</th>
            <th scope="col">{t("keys.created")}</th>
            <th scope="col">{t("keys.expires")}</th>
            <th scope="col">{t("keys.used")}</th>
            <th scope="col">{t("keys.state")}</th>
            <th scope="col">{t("keys.actions")}</th>
          </tr>
        </thead>
        <tbody>
          {inOrder(keys.value, Date.now()).map((key) => (
            <Row key={key.id} of={key} />
          ))}
        </tbody>
      </table>
    </section>
  );
}

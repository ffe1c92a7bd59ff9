/** For operators: whose drives and keys there are, and making another owner. */
import { useSignal } from "@preact/signals";
import { moment, number } from "../shared/format";
import { tellDone } from "../shared/Messages";
import { useSending } from "../shared/sending";
import { t } from "../shared/texts";
import { makeOwner, owners } from "./state";

function MakeOwner() {
  const name = useSignal("");
  const { busy, submit, failure } = useSending(async () => {
    const wanted = name.value.trim();
    await makeOwner(wanted);
    tellDone(t("keys.owner_made", { name: wanted }));
    name.value = "";
  });
  return (
    <form class="making-owner" onSubmit={submit}>
      <label>
        <span>{t("keys.owner_name")}</span>
        <input
          value={name.value}
          required
          maxLength={100}
          onInput={(event) => {
            name.value = event.currentTarget.value;
          }}
        />
      </label>
      <button type="submit" disabled={busy}>
        {t("keys.make_owner")}
      </button>
      {failure}
    </form>
  );
}

export function Owners() {
  if (owners.value === null) return null;
  return (
    <>
      <h2 id="owners">{t("keys.owners")}</h2>
      <p>{t("keys.owners_what")}</p>
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is reached by keyboard */}
      <section class="wide" tabIndex={0} aria-labelledby="owners">
        <table>
          <thead>
            <tr>
              <th scope="col">{t("keys.owner_name")}</th>
              <th scope="col">{t("keys.created")}</th>
              <th scope="col" class="number">
                {t("keys.title")}
              </th>
              <th scope="col" class="number">
                {t("page.drives")}
              </th>
            </tr>
          </thead>
          <tbody>
            {owners.value.map((one) => (
              <tr key={one.id}>
                <th scope="row">
                  <a href={`/owner?owner=${one.id}`}>{one.name}</a>
                </th>
                <td>{moment(one.created_at)}</td>
                <td class="number">{number(one.keys)}</td>
                <td class="number">{number(one.drives)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </section>
      <MakeOwner />
    </>
  );
}

/** What the address of the login page says: the login link that it holds, and where to go on. Asks nobody. */

const LOGIN = "/login";
const ODD = /[\p{Cc}\\]/u;

/**
 * The path of this site that `return_to` names; null where it names anything else: a login must not lead to where
 * somebody else wants the visitor to be. Browsers read `/\\host` and `//host` as addresses of other hosts, and skip tabs
 * and ends of lines between the two.
 */
export function returnTo(search: string, origin: string): string | null {
  const asked = new URLSearchParams(search).get("return_to");
  if (asked === null || !asked.startsWith("/") || ODD.test(asked)) return null;
  let there: URL;
  try {
    there = new URL(asked, origin);
  } catch {
    return null;
  }
  // Without its dots, `/.//host` is another host's as well.
  const elsewhere = there.origin !== origin || asked.startsWith("//") || there.pathname.startsWith("//");
  if (elsewhere || there.pathname === LOGIN) return null;
  return there.pathname + there.search + there.hash;
}

/** The login link in a fragment, which browsers keep to themselves; null: there is none. */
export function linkOf(hash: string): string | null {
  return new URLSearchParams(hash.replace(/^#/, "")).get("link") || null;
}

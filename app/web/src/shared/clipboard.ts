/** Put text on the clipboard, also where the page came by plain http from another machine; throws `refused` otherwise. */
export async function copy(text: string, refused: string): Promise<void> {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  const field = document.body.appendChild(document.createElement("textarea"));
  field.value = text;
  field.select();
  const done = document.execCommand("copy");
  field.remove();
  if (!done) throw new Error(refused);
}

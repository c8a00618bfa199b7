// Words of people and agents. They go over the simulated radio channel: they take their time, reach and bytes.

const KEPT_WORDS = 60;

class Chat {
  /** `say(text)` sends; `leave()` gives the keys back to driving. */
  constructor(say, leave) {
    this.unread = 0;
    $("say").addEventListener("submit", (event) => {
      event.preventDefault();
      const text = $("say-text").value.trim();
      if (!text) return;
      say(text);
      this.add("you", text, true);
      $("say-text").value = "";
    });
    $("say-text").addEventListener("keydown", (event) => {
      event.stopPropagation(); // keys write here, they do not drive
      if (event.key !== "Escape") return;
      $("say-text").blur();
      leave();
    });
  }

  get isOpen() {
    return !$("talk").hidden;
  }

  toggle(isOpen = !this.isOpen) {
    $("talk").hidden = !isOpen;
    setPressed($("do-chat"), isOpen);
    if (!isOpen) return;
    this.unread = 0;
    this.showUnread();
    $("words").scrollTop = $("words").scrollHeight;
    $("say-text").focus();
  }

  add(from, text, isOwn = false) {
    const line = make("li", isOwn ? "own" : "");
    line.append(make("b", "", from), make("span", "", text));
    $("words").append(line);
    while ($("words").children.length > KEPT_WORDS) $("words").firstElementChild.remove();
    $("words").scrollTop = $("words").scrollHeight;
    if (!this.isOpen && !isOwn) this.unread += 1;
    this.showUnread();
  }

  /** Warnings of others, and their last words as long as they are fresh and the chat is closed. */
  showHeard({ words = [], warnings = [] }) {
    const lines = [...warnings.map(({ from, text }) => ({ from, text: `⚠ ${text}`, kind: "warning" })), ...(this.isOpen ? [] : words)];
    $("heard").hidden = !lines.length;
    const heard = lines.map(({ from, text }) => `${from} ${text}`).join("\n");
    if ($("heard").hidden || this.heard === heard) return;
    this.heard = heard;
    $("heard").replaceChildren(...lines.map(({ from, text, kind }) => {
      const line = make("li", kind ?? "");
      line.append(make("b", "", nameCav(from)), text);
      return line;
    }));
  }

  showUnread() {
    $("do-chat").dataset.unread = this.unread || "";
  }
}

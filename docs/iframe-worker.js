// Search works in a web worker, which browsers refuse to pages that are opened as files: a hidden frame takes its place.
if (location.protocol === "file:") {
  let count = 0;
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const name = `answerOfFrame${count++}`;
      window[name] = (data) => {
        const event = new MessageEvent("message", { data });
        this.dispatchEvent(event);
        this.onmessage?.(event);
      };
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      this.frame.srcdoc = `<script>postMessage = (data) => parent.${name}(data)</script><script src="${url}"></script>`;
      this.ready = new Promise((resolve) => this.frame.addEventListener("load", resolve, { once: true }));
      document.body.append(this.frame);
    }

    postMessage(data) {
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data })));
    }

    terminate() { this.frame.remove(); }
  };
}

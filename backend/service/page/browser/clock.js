// One clock for all pictures of a view: whoever plays tells the time, whoever is clicked asks for another.
const TOLD = "linktwin:time", ASKED = "linktwin:seek", PART = "linktwin:part";

const send = (name, detail) => window.dispatchEvent(new CustomEvent(name, { detail }));
function hear(name, listen) {
  const heard = (event) => listen(event.detail);
  window.addEventListener(name, heard);
  return () => window.removeEventListener(name, heard);
}

export const tellTime = (motion, time_s) => send(TOLD, { motion, time_s });
export const askTime = (motion, time_s) => send(ASKED, { motion, time_s });
export const pointAt = (part) => send(PART, { part });
export const onTime = (listen) => hear(TOLD, listen);
export const onAsked = (listen) => hear(ASKED, listen);
export const onPart = (listen) => hear(PART, listen);

// Whom a live page asks: the server that gave it.

function asking() {
  const token = document.querySelector('meta[name="token"]').content;
  return async (path, body) => {
    const answer = await fetch(path, { method: body ? "POST" : "GET", headers: { "X-Bondgraph-Token": token, ...(body && { "Content-Type": "application/json" }) }, body: body && JSON.stringify(body), cache: "no-store" });
    if (!answer.ok) throw new Error(await answer.text());
    return answer.json();
  };
}

// Sparkplug payloads in base64, one a line, decoded by the npm package sparkplug-payload; and the other way.
"use strict";
const sparkplug = require("sparkplug-payload").get("spBv1.0");
const long = value => (value !== null && typeof value === "object" && "low" in value
  ? value.toUnsigned().toNumber() : value);
const lines = require("fs").readFileSync(0, "utf8").split("\n").filter(Boolean);
for (const line of lines) {
  if (process.argv[2] === "encode") {
    process.stdout.write(Buffer.from(sparkplug.encodePayload(JSON.parse(line))).toString("base64") + "\n");
    continue;
  }
  const payload = sparkplug.decodePayload(Buffer.from(line, "base64"));
  process.stdout.write(JSON.stringify(payload, (_, value) => long(value)) + "\n");
}

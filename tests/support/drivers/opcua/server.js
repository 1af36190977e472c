// An OPC UA server that is not Abbe's: node-opcua, told what to say by lines of JSON.
"use strict";
const OwnDate = Date;
let ahead = 0;       // ms by which its clock was set forward
globalThis.Date = class extends OwnDate {
  constructor(...at) { if (at.length) super(...at); else super(OwnDate.now() + ahead); }
  static now() { return OwnDate.now() + ahead; }
};
const parts = ["server", "data-value", "variant", "status-code", "data-access", "secure-channel",
  "certificate-manager", "common", "types"];
const { OPCUAServer, OPCUACertificateManager, DataValue, DataType, Variant, VariantArrayType, StatusCode,
  StatusCodes, standardUnits, makeEUInformation, MessageSecurityMode, SecurityPolicy } =
  Object.assign({}, ...parts.map(part => require("node-opcua-" + part)));
const readline = require("readline");
const folder = process.argv[2];
const now = {};      // name -> { value, status, bits, clock, source_age, server_age, source_at }
const kinds = {
  x: "Double", y: "Double", z: "Double", T: "Float", inch: "Double", arr: "Double", flag: "Boolean",
  text: "String", n: "Int32", big: "UInt64",
};
const first = { x: 1.5, y: 2.5, z: 3.5, T: 20.25, inch: 1, arr: [1, 2, 3], flag: true, text: "no",
  n: -7, big: [0, 12] };

function answer(name) {
  const said = now[name], at = Date.now();
  const stamp = age => (age === null ? undefined : new Date(at - 1000 * (age || 0)));
  return new DataValue({
    statusCode: said.status === undefined ? StatusCodes.Good
      : said.bits === undefined ? StatusCodes[said.status]
        : StatusCode.makeStatusCode(StatusCodes[said.status], said.bits),
    value: new Variant({
      dataType: DataType[kinds[name]], value: said.clock ? OwnDate.now() / 1000 : said.value,
      arrayType: Array.isArray(said.value) && kinds[name] !== "UInt64"
        ? VariantArrayType.Array : VariantArrayType.Scalar,
    }),
    sourceTimestamp: said.source_at === undefined ? stamp(said.source_age) : new Date(1000 * said.source_at),
    serverTimestamp: stamp(said.server_age),
  });
}

async function main() {
  const manager = new OPCUACertificateManager({
    rootFolder: folder, automaticallyAcceptUnknownCertificate: true });
  await manager.initialize();
  const server = new OPCUAServer({
    port: Number(process.argv[3] || 0), hostname: "127.0.0.1", serverCertificateManager: manager,
    securityModes: [MessageSecurityMode.None, MessageSecurityMode.Sign, MessageSecurityMode.SignAndEncrypt],
    securityPolicies: [SecurityPolicy.None, SecurityPolicy.Basic256Sha256,
      SecurityPolicy.Aes128_Sha256_RsaOaep, SecurityPolicy.Aes256_Sha256_RsaPss],
    allowAnonymous: true,
    userManager: { isValidUser: (user, password) => user === "metrology" && password === "sécret" },
  });
  await server.initialize();
  const space = server.engine.addressSpace;
  // a server that was given other models before it started again numbers its namespaces anew
  for (let i = 0; i < Number(process.argv[4] || 0); i++) space.registerNamespace("http://example.org/" + i);
  const own = space.registerNamespace("http://example.org/mill");
  for (const [name, kind] of Object.entries(kinds)) {
    now[name] = { value: first[name] };
    const options = {
      organizedBy: space.rootFolder.objects, browseName: name, nodeId: `s=Mill/${name}`, dataType: kind,
      minimumSamplingInterval: 10,
    };
    if (name === "arr") Object.assign(options, { valueRank: 1, arrayDimensions: [0] });
    const mm = standardUnits.millimetre;
    const units = { x: mm, y: mm, z: mm, T: standardUnits.degree_celsius,
      inch: makeEUInformation("INH", "in", "inch") }[name];
    const node = units === undefined ? own.addVariable(options)
      : own.addAnalogDataItem(Object.assign(options, {
        engineeringUnitsRange: { low: -1e4, high: 1e4 }, engineeringUnits: units }));
    node.bindVariable({ timestamped_get: () => answer(name) }, true);
  }
  await server.start();
  const port = server.endpoints[0].port;
  process.stdout.write(JSON.stringify({ port, uri: "http://example.org/mill", namespace: own.index,
    certificate: server.certificateFile }) + "\n");
  for await (const line of readline.createInterface({ input: process.stdin })) {
    const order = JSON.parse(line);
    for (const [name, said] of Object.entries(order.say || {})) now[name] = said;
    if (order.state !== undefined) server.engine.setServerState(order.state);
    if (order.ahead !== undefined) ahead = 1000 * order.ahead;
    const kept = Object.values(server.engine._sessions).flatMap(session =>
      session.publishEngine.subscriptions.map(subscription => [session, subscription]));
    if (order.forget) for (const [session, subscription] of kept) session.deleteSubscription(subscription.id);
    if (order.end) break;
    process.stdout.write(JSON.stringify({ done: true, sessions: server.engine.currentSessionCount,
      subscriptions: kept.length }) + "\n");
  }
  await server.shutdown(0);
  process.exit(0);
}
main().catch(error => { process.stderr.write(String(error.stack) + "\n"); process.exit(1); });

// An OPC UA client that is not Abbe's: node-opcua, with one connection and some orders, all given as JSON.
"use strict";
const parts = ["client", "data-value", "variant", "status-code", "secure-channel", "certificate-manager",
  "common", "types", "data-model"];
const { OPCUAClient, OPCUACertificateManager, MessageSecurityMode, SecurityPolicy, UserTokenType, AttributeIds,
  ClientSubscription, TimestampsToReturn, ClientMonitoredItem, Variant, DataType, constructEventFilter } =
  Object.assign({}, ...parts.map(part => { try { return require("node-opcua-" + part); } catch { return {}; } }),
    require("node-opcua-client"));
const given = JSON.parse(process.argv[2]);
const plain = value => ({ value: value.value ? value.value.value : null, status: value.statusCode.name,
  source: value.sourceTimestamp ? value.sourceTimestamp.getTime() / 1000 : null });
const out = what => process.stdout.write(JSON.stringify(what,
  (_, v) => (v && typeof v === "object" && v.constructor && v.constructor.name === "BigInt" ? Number(v) : v)) + "\n");

async function obey(session, order) {
  if (order.read) {
    const found = await session.read(order.read.map(nodeId => ({ nodeId, attributeId: AttributeIds.Value })));
    return found.map(plain);
  }
  if (order.unit) {
    const found = await session.read({ nodeId: order.unit, attributeId: AttributeIds.Value });
    const unit = found.value.value;
    return { number: unit.unitId, namespace: unit.namespaceUri, name: unit.displayName.text };
  }
  if (order.browse) {
    const found = await session.browse(order.browse);
    return found.references.map(one => one.browseName.name);
  }
  if (order.write) {
    const status = await session.write({ nodeId: order.write, attributeId: AttributeIds.Value,
      value: { value: new Variant({ dataType: DataType.Double, value: 1 }) } });
    return status.name;
  }
  // values or events as they come, until there are so many
  const subscription = ClientSubscription.create(session, { requestedPublishingInterval: 50,
    requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 20, publishingEnabled: true, priority: 1 });
  const what = order.subscribe
    ? [{ nodeId: order.subscribe, attributeId: AttributeIds.Value }, { samplingInterval: 0, queueSize: 50 }]
    : [{ nodeId: "i=2253", attributeId: AttributeIds.EventNotifier },
      { samplingInterval: 0, queueSize: 50, filter: constructEventFilter(["Message", "Severity", "SourceName"]) }];
  const item = ClientMonitoredItem.create(subscription, what[0], what[1], TimestampsToReturn.Both);
  const seen = [];
  return await new Promise((resolve, reject) => {
    item.on("err", reject);
    item.on("initialized", () => out({ ready: true }));
    item.on("changed", value => {
      seen.push(order.subscribe ? plain(value)
        : { text: value[0].value.text, severity: value[1].value, source: value[2].value });
      if (seen.length >= order.count) resolve(seen);
    });
  });
}

async function main() {
  const manager = new OPCUACertificateManager({ rootFolder: given.folder, automaticallyAcceptUnknownCertificate: true });
  await manager.initialize();
  const client = OPCUAClient.create({ endpointMustExist: false, clientCertificateManager: manager,
    securityMode: MessageSecurityMode[given.mode || "None"], securityPolicy: SecurityPolicy[given.policy || "None"],
    connectionStrategy: { maxRetry: given.retry || 0, initialDelay: 100 }, transportTimeout: 60000, requestedSessionTimeout: 60000 });
  await client.connect(given.url);
  const session = await client.createSession(given.user
    ? { type: UserTokenType.UserName, userName: given.user, password: given.password } : undefined);
  for (const order of given.orders) out(await obey(session, order));
  await session.close();
  await client.disconnect();
  process.exit(0);
}
main().catch(error => { out({ error: String(error.message) }); process.exit(1); });

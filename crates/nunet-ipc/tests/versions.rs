//! Services of another version of the contract are refused by name, before anything of them is believed.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

mod support;

use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use nunet_ipc::{CONTRACT_ATTRIBUTE, IpcError, IpcErrorKind, Limits, Publisher, Reader, Topic};
use support::{TIMEOUT, camera, plan};

/// A header as a later version might have it: another size under another name.
#[derive(Debug, Default, Clone, Copy, ZeroCopySend)]
#[type_name("nunet.v2.FrameHeader")]
#[repr(C)]
struct LaterHeader {
    contract_version: u64,
}

/// The same root as nunet-ipc's, for services that it did not create.
fn config() -> Config {
    let mut config = Config::global_config().clone();
    config.global.set_root_path(&nunet_ipc::root().to_str().unwrap().try_into().unwrap());
    config.global.prefix = nunet_ipc::shared_memory_prefix().as_str().try_into().unwrap();
    config
}

#[test]
fn a_service_of_another_version_is_refused_by_readers_and_publishers() {
    let camera = camera();
    let node = NodeBuilder::new().config(&config()).create::<ipc::Service>().unwrap();
    let name: ServiceName = camera.service(Topic::Depth).as_str().try_into().unwrap();
    let (key, two) = (CONTRACT_ATTRIBUTE.try_into().unwrap(), "2".try_into().unwrap());
    let attributes = AttributeSpecifier::new().define(&key, &two).unwrap();
    let builder = node.service_builder(&name).publish_subscribe::<[u64]>().user_header::<LaterHeader>();
    let _later = builder.create_with_attributes(&attributes).unwrap();

    let of_reader = Reader::open(&camera, &[Topic::Depth], TIMEOUT).unwrap_err();
    let of_publisher = Publisher::create(&camera, &[plan(Topic::Depth)], &Limits::default()).unwrap_err();
    for error in [of_reader, of_publisher] {
        assert_eq!(error.kind(), IpcErrorKind::ContractVersion);
        let IpcError::ContractVersion { service, found, expected } = &error else { panic!("{error}") };
        let expected_service = camera.service(Topic::Depth);
        assert_eq!((service, found.as_str(), *expected), (&expected_service, "2", 1));
    }
}

#[test]
fn a_service_without_a_version_is_refused() {
    let camera = camera();
    let node = NodeBuilder::new().config(&config()).create::<ipc::Service>().unwrap();
    let name: ServiceName = camera.service(Topic::Depth).as_str().try_into().unwrap();
    let _foreign = node.service_builder(&name).publish_subscribe::<u64>().create().unwrap();
    let error = Reader::open(&camera, &[Topic::Depth], TIMEOUT).unwrap_err();
    assert!(matches!(&error, IpcError::ContractVersion { found, .. } if found == "none"), "{error}");
}

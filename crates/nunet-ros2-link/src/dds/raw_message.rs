//! Messages that are encoded already.

use dust_dds::xtypes::dynamic_type::{
    DynamicData, DynamicDataFactory, DynamicType, DynamicTypeMember, ExtensibilityKind, MemberDescriptor,
    TryConstructKind, TypeDescriptor, TypeKind,
};
use dust_dds::xtypes::type_support::{Type, TypeSupport};

/// The fields of a message in CDR, without the four leading bytes.
///
/// To the library it is an array of bytes. Arrays have no length in CDR, and the library writes as many
/// elements as there are, so that the bytes arrive as they are.
#[derive(Debug)]
pub(super) struct RawMessage(pub(super) Vec<u8>);

const BYTES: u32 = 0;

impl Type for RawMessage {
    const TYPE: DynamicType<'static> = DynamicType {
        descriptor: &TypeDescriptor {
            kind: TypeKind::STRUCTURE,
            name: "RawMessage",
            base_type: None,
            discriminator_type: None,
            bound: &[],
            element_type: None,
            key_element_type: None,
            extensibility_kind: ExtensibilityKind::Final,
            is_nested: false,
            is_autoid_hash: false,
        },
        member_list: &[DynamicTypeMember {
            descriptor: MemberDescriptor {
                name: "bytes",
                id: BYTES,
                r#type: <[u8; 1] as Type>::TYPE,
                default_value: None,
                index: 0,
                label: &[],
                try_construct_kind: TryConstructKind::Discard,
                is_key: false,
                is_optional: false,
                is_must_understand: false,
                is_shared: false,
                is_default_label: false,
                is_external: false,
            },
        }],
    };
}

impl TypeSupport for RawMessage {
    /// Received bytes come from the transport: the library would read as many as the type states.
    fn create_sample(_: &mut DynamicData<'static>) -> Option<Self> {
        None
    }

    fn create_dynamic_sample(self) -> DynamicData<'static> {
        let mut data = DynamicDataFactory::create_data(Self::TYPE);
        // It has this member.
        let _ = data.set_uint8_values(BYTES, self.0);
        data
    }
}

//! What a kernel is given, by the names that it has for it.

/// What a kernel can be given by name. Buffers and textures are counted: a copy of a resource holds
/// the same one.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Resource {
    /// A whole storage or uniform buffer.
    Buffer(wgpu::Buffer),
    /// Some bytes of a buffer: they begin at a multiple of 256.
    Bytes(Bytes),
    /// A texture.
    Texture(wgpu::TextureView),
}

impl From<&wgpu::Buffer> for Resource {
    fn from(buffer: &wgpu::Buffer) -> Self {
        Self::Buffer(buffer.clone())
    }
}

impl From<&wgpu::TextureView> for Resource {
    fn from(view: &wgpu::TextureView) -> Self {
        Self::Texture(view.clone())
    }
}

/// A part of a buffer.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Bytes {
    /// The buffer.
    pub buffer: wgpu::Buffer,
    /// Where the part begins.
    pub offset: u64,
    /// How many bytes it has.
    pub size: u64,
}

impl Bytes {
    /// All of a buffer.
    pub fn all(buffer: &wgpu::Buffer) -> Self {
        Self { offset: 0, size: buffer.size(), buffer: buffer.clone() }
    }
}

impl From<Bytes> for Resource {
    fn from(bytes: Bytes) -> Self {
        Self::Bytes(bytes)
    }
}

/// Resources by the name that the kernels give them.
pub type Bindings = Vec<(&'static str, Resource)>;

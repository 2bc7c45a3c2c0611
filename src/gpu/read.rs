//! Reading what the device has, with or without waiting for it.

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::task::Poll;

use super::queue::{ANSWERED, ASKED, Command};
use super::resource::Bytes;
use super::{Gpu, lock};
use crate::error::{Error, Result};

/// Some 32-bit words of a buffer.
#[derive(Clone)]
pub struct Words {
    /// The buffer.
    pub buffer: wgpu::Buffer,
    /// Which of its words.
    pub range: Range<u64>,
}

impl Words {
    /// The first word of a buffer.
    pub fn first(buffer: &wgpu::Buffer) -> Self {
        Self { buffer: buffer.clone(), range: 0..1 }
    }
}

/// Words that were asked for.
pub struct Reading {
    stage: &'static str,
    staging: wgpu::Buffer,
    bytes: u64,
    answer: Arc<AtomicU8>,
}

/// Lets others on who wait on the same thread.
pub async fn others_first() {
    let mut were_asked = false;
    std::future::poll_fn(|context| {
        if std::mem::replace(&mut were_asked, true) {
            return Poll::Ready(());
        }
        context.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

/// Bytes that are read through a buffer that stays.
const SHORT: u64 = 1 << 16;

impl Gpu {
    /// Copies a buffer back to the host.
    ///
    /// # Errors
    /// The device failed.
    pub fn read<T: bytemuck::Pod>(
        &self,
        stage: &'static str,
        buffer: &wgpu::Buffer,
    ) -> Result<Vec<T>> {
        let reading = self.ask_for(stage, &[Bytes::all(buffer)])?;
        self.wait_for_answer(&reading)?;
        self.taken(reading)
    }

    /// Copies 32-bit words of buffers back to the host, together: a device that is waited for
    /// once rests less than one that is waited for again and again.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_words(&self, stage: &'static str, parts: &[Words]) -> Result<Vec<u32>> {
        let reading = self.ask(stage, parts)?;
        self.wait_for_answer(&reading)?;
        self.taken(reading)
    }

    /// Asks for 32-bit words of buffers, as they are when all that was recorded is done.
    ///
    /// # Errors
    /// The device failed.
    pub fn ask(&self, stage: &'static str, parts: &[Words]) -> Result<Reading> {
        let bytes = parts.iter().map(|Words { buffer, range }| Bytes {
            buffer: buffer.clone(),
            offset: 4 * range.start,
            size: 4 * (range.end - range.start),
        });
        self.ask_for(stage, &bytes.collect::<Vec<_>>())
    }

    /// Whether the answer is there; nobody waits.
    ///
    /// # Errors
    /// The device failed.
    pub fn is_answered(&self, reading: &Reading) -> Result<bool> {
        self.poll(reading.stage)?;
        Ok(reading.answer.load(Ordering::Acquire) != ASKED)
    }

    /// Waits for the answer, if it is not there.
    ///
    /// # Errors
    /// The device failed.
    pub fn wait_for_answer(&self, reading: &Reading) -> Result<()> {
        self.submit()?;
        if reading.answer.load(Ordering::Acquire) == ASKED {
            lock(&self.clock).effort.waits += 1;
            self.wait_for(None, reading.stage)?;
        }
        // Another thread that waits may be the one that hears of it.
        while reading.answer.load(Ordering::Acquire) == ASKED {
            std::thread::yield_now();
            self.poll(reading.stage)?;
        }
        Ok(())
    }

    /// The answer, when it is there: nobody is blocked. (Where no browser does so, whoever awaits it
    /// asks the device again and again.)
    ///
    /// # Errors
    /// The device failed.
    pub async fn answer<T: bytemuck::Pod>(&self, reading: Reading) -> Result<Vec<T>> {
        self.submit()?;
        while !self.is_answered(&reading)? {
            others_first().await;
        }
        self.taken(reading)
    }

    /// The answer, which is there.
    ///
    /// # Errors
    /// The device failed.
    pub fn taken<T: bytemuck::Pod>(&self, reading: Reading) -> Result<Vec<T>> {
        let Reading { stage, staging, bytes, answer } = reading;
        if answer.load(Ordering::Acquire) != ANSWERED {
            return Err(Error::device(stage, "nothing can be read back"));
        }
        let view =
            staging.get_mapped_range(..bytes).map_err(|e| Error::device(stage, e.to_string()))?;
        let mut copy = vec![T::zeroed(); view.len() / size_of::<T>()];
        let length = size_of_val(copy.as_slice());
        bytemuck::cast_slice_mut(&mut copy).copy_from_slice(&view[..length]);
        drop(view);
        staging.unmap();
        if bytes <= SHORT {
            lock(&self.staging).push(staging);
        }
        Ok(copy)
    }

    fn ask_for(&self, stage: &'static str, parts: &[Bytes]) -> Result<Reading> {
        let bytes = parts.iter().map(|part| part.size).sum();
        // Short readings are many, and a new buffer for each takes longer than the copy.
        let is_short = bytes <= SHORT;
        let spare = if is_short { lock(&self.staging).pop() } else { None };
        let staging = spare.unwrap_or_else(|| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(stage),
                size: if is_short { SHORT } else { bytes },
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        });
        let answer = Arc::new(AtomicU8::new(ASKED));
        let (mut copies, mut at) = (self.stage(stage), 0);
        for part in parts {
            copies.copy(part.clone(), &staging, at);
            at += part.size;
        }
        let (heard, to) = (answer.clone(), staging.clone());
        copies.push(Command::Read { staging: to, bytes, answer: heard });
        copies.finish()?;
        Ok(Reading { stage, staging, bytes, answer })
    }

    /// Waits until all recorded work is done.
    ///
    /// # Errors
    /// The device failed.
    pub fn wait(&self, stage: &str) -> Result<()> {
        self.submit()?;
        lock(&self.clock).effort.waits += 1;
        self.wait_for(None, stage)
    }

    /// Waits until a submission is done, or all are.
    pub(super) fn wait_for(
        &self,
        submission: Option<wgpu::SubmissionIndex>,
        stage: &str,
    ) -> Result<()> {
        self.polled(wgpu::PollType::Wait { submission_index: submission, timeout: None }, stage)
    }

    /// Hears of what is done.
    pub(super) fn poll(&self, stage: &str) -> Result<()> {
        self.polled(wgpu::PollType::Poll, stage)
    }

    fn polled(&self, how: wgpu::PollType, stage: &str) -> Result<()> {
        // wgpu panics where it finds the device lost while it waits, and only there.
        let waited = catch_unwind(AssertUnwindSafe(|| self.device.poll(how)));
        self.check(stage)?;
        match waited {
            Ok(polled) => polled.map(|_| ()).map_err(|e| Error::device(stage, e.to_string())),
            Err(_) => {
                Err(Error::device(stage, "the device was lost; another --adapter may fare better"))
            }
        }
    }
}
